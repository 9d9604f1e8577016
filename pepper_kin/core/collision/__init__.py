"""Collision checks of many configurations against one block of constants."""
