"""Configurations: YAML, overrides and checks, and a command line that refuses in one sentence."""

from agents.config.load import ConfigError, Parser, Strict, dump, load
from agents.config.world import AircraftConfig, ScenarioConfig, VehicleConfig
from commands.command import run_cli

__all__ = [
    "AircraftConfig",
    "ConfigError",
    "Parser",
    "ScenarioConfig",
    "Strict",
    "VehicleConfig",
    "dump",
    "load",
    "run_cli",
]
