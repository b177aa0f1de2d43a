"""The web server: where it listens, who may connect, what a browser may say, the page that it serves."""
