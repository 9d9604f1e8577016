"""Files, of whatever content: read with refusals that name the file, and written whole or not at all.

reading          bytes, texts, JSON and numbers of files
numpy_archive    NumPy archives, within a memory limit
atomic_file      writing
"""
