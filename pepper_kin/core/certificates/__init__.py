"""Machine code used only by certificates: it shares no function with the rest of the core."""
