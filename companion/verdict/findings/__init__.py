"""What stands out in a flight: a module for each kind of fault, `detect` for which of them are only effects."""
