"""Files of encounters and tracks: read, checked, written.

The readers of geographic positions, ``adsb_file``, ``adsb_pairs`` and ``track_files``, need pyproj
(the extra ``report``) and are imported from their modules.
"""

from envs.formats.encounter_file import read, write
from envs.formats.lincoln_file import read_lincoln

__all__ = ["read", "read_lincoln", "write"]
