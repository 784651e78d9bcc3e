"""The Cosserat rod on a staggered grid."""

from softrobot_env.beams.cosserat.model import MOMENTS, CosseratRod

__all__ = ["MOMENTS", "CosseratRod"]
