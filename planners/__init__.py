"""Robot-agnostic motion planners."""
