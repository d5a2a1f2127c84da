"""Files of encounters and tracks: read, checked, written. Geographic positions need pyproj (the extra ``report``)."""

from envs.formats.adsb_file import read_adsb
from envs.formats.adsb_pairs import adsb_pairs
from envs.formats.encounter_file import read, write
from envs.formats.lincoln_file import read_lincoln
from envs.formats.track_files import read_daidalus

__all__ = ["adsb_pairs", "read", "read_adsb", "read_daidalus", "read_lincoln", "write"]
