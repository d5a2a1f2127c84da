"""Configurations: YAML, overrides and checks, and a command line that refuses in one sentence."""

from agents.config.load import ConfigError, Parser, Strict, dump, load
from agents.config.world import AircraftConfig, RulesConfig, ScenarioConfig, VehicleConfig
from envs.edge.command import run_cli

__all__ = [
    "AircraftConfig",
    "ConfigError",
    "Parser",
    "RulesConfig",
    "ScenarioConfig",
    "Strict",
    "VehicleConfig",
    "dump",
    "load",
    "run_cli",
]
