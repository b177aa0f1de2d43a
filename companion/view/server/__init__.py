"""The web server: where it listens, who may connect, what a browser may send, the page that it serves."""
