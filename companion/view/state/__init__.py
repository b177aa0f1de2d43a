"""What a page shows and what was asked of it, as plain values: no browser in it."""
