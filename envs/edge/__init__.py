"""The edge of every program: its command line, its refusals and its files; the standard library
alone.
"""
