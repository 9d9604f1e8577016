"""The description of Pepper: xacro sources and the data they are written from."""
