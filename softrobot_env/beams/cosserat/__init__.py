"""The Cosserat rod on a staggered grid."""

from softrobot_env.beams.cosserat.model import GRIDS, MOMENTS, CosseratRod

__all__ = ["GRIDS", "MOMENTS", "CosseratRod"]
