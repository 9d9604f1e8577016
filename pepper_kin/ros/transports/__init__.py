"""Ways by which messages travel."""
