"""What draws the documentation's pictures: see `docs/make_pictures.py`."""
