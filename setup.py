"""For colcon, which looks for this file; everything stands in pyproject.toml and setup.cfg."""

from setuptools import setup

setup()
