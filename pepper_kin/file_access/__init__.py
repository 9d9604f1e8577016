"""Reading of files with errors that name the file, and atomic writing.

reading          bytes, texts, JSON and numbers of files
numpy_archive    NumPy archives, within a memory limit
atomic_file      writing
"""
