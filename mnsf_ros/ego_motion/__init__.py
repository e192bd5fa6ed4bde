"""How the sensor itself moved from sweep to sweep."""
