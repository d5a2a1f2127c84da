"""Files of encounters and tracks: read, checked, written.

The readers of geographic positions, :mod:`envs.formats.adsb_file`, :mod:`envs.formats.adsb_pairs` and
:mod:`envs.formats.track_files`, need pyproj (the extra ``report``) and are imported from their modules.
"""

from envs.formats.encounter_file import read, write
from envs.formats.lincoln_file import read_lincoln

__all__ = ["read", "read_lincoln", "write"]
