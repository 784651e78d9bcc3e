"""The Cosserat rod on a staggered grid."""

from .model import GRIDS, MOMENTS, CosseratRod

__all__ = ["GRIDS", "MOMENTS", "CosseratRod"]
