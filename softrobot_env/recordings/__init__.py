"""Recordings of robots: a table of commands and marker positions, and a header that explains it.

The table is CSV or Parquet as a laboratory's program wrote it (or a Minari data set, or an MCAP
file). The header is a short TOML file that says which column is what, in which unit and frame:
`NAME.toml` beside `NAME.csv`, or any other that is named. What is read has SI units.
"""

from .files import read_recording, write_recording
from .header import Commands, Frame, Header, Marker, Time, read_header, write_header
from .recording import Recording

__all__ = [
    "Commands",
    "Frame",
    "Header",
    "Marker",
    "Recording",
    "Time",
    "read_header",
    "read_recording",
    "write_header",
    "write_recording",
]
