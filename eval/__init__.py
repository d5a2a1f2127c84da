"""Evaluation: simulated encounters, statistics, figures and reports."""
