"""The charts beside the picture."""
