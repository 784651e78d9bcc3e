"""`softrobot robot camera`: print a board or a tag, calibrate a camera with pictures."""

from argparse import Namespace

import numpy as np

from softrobot_env.core.extras import needed
from softrobot_env.core.files import atomic_write
from softrobot_env.hardware import camera
from softrobot_env.rendering.tables import named_values

from ..arguments import positive
from ..output import new_file, say

EXAMPLE = """softrobot robot camera --out board.pdf
  softrobot robot camera --tag 7 --side 0.04 --out tag_7.pdf
  softrobot robot camera views/*.png --side 0.0299 --out camera.toml"""

ARGUMENTS = """
    images PATH*  pictures of the board, flat, from near and far and aside, also in the picture's
        corners; default: write the board, to be printed
    --tag NUMBER  write this tag of family 36h11 instead
    --side S (0.03)  m, of a square of the board as measured on paper, or of the tag's black square
    --out FILE!  .toml of a camera, .pdf or .png of what is to be printed
    <overwrite>
"""
KINDS = {"side": positive, "tag": int}

_PAPER = 60  # white border of a sheet, in dots
_INCH = 0.0254  # m


def run(args: Namespace) -> int:
    """Run the command; 1 if some pictures do not show the board."""
    with new_file(args.out, args.overwrite):
        return _calibrate(args) if args.images else _write_sheet(args)


def _write_sheet(args: Namespace) -> int:
    sheet, dots = camera.board_sheet(), camera.SQUARE_DOTS
    if args.tag is not None:
        sheet, dots = camera.tag_sheet(args.tag), camera.TAG_DOTS
    with needed("sheets need Pillow", "camera"):
        from PIL import Image
    image = Image.fromarray(np.pad(sheet, _PAPER, constant_values=255))
    with atomic_write(args.out) as path:
        rate = dots / args.side * _INCH
        image.save(path, resolution=rate, dpi=(rate, rate))
    say(f"Wrote {args.out}: print it at 100 %, and measure {1e3 * args.side:g} mm on the paper")
    return 0


def _calibrate(args: Namespace) -> int:
    found, unseen = camera.calibrated(args.images, args.side)
    camera.write_camera(found, args.out)
    say(named_values("Camera", {name: str(value) for name, value in vars(found).items()}))
    for path in unseen:
        say(f"{path} does not show enough of the board")
    return int(bool(unseen))
