"""Machine code of certificates only: it calls nothing of the other core, and nothing of that calls it."""
