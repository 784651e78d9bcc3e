"""Rows of benchmarks, see `core.runs`."""

from softrobot_env.core.runs import Record, for_pictures, groups, names, of_kind, one, select

__all__ = ["Record", "for_pictures", "groups", "names", "of_kind", "one", "select"]
