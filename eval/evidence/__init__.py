"""The list of all published evaluations, their results, and the tables that are generated from
them.
"""
