"""The visual shapes of Pepper, lofted from measured sections."""
