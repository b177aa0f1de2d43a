"""What a page shows and what was requested of it, as plain values: no browser in it."""
