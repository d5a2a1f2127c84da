"""Recorded tracks flown again, and models of traffic."""

from envs.traffic.encounter_model import EncounterModel, read_model
from envs.traffic.model_traffic import ModelTraffic
from envs.traffic.replay import Replay, encounters_of
from envs.traffic.tracks import Track, TrackError, TrackFile

__all__ = [
    "EncounterModel",
    "ModelTraffic",
    "Replay",
    "Track",
    "TrackError",
    "TrackFile",
    "encounters_of",
    "read_model",
]
