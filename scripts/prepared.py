"""Make the LLVM code anew that comes with the package, see `softrobot_env/compile/prepared.py`.

python scripts/prepared.py            # or make prepared
python scripts/prepared.py --check    # whether it is of these sources
"""

import sys
from argparse import ArgumentParser

from softrobot_env.compile.prepared import PreparedFunction
from softrobot_env.scene.integration import period

FUNCTIONS: list[PreparedFunction] = [period.refresh.owner, period.advance.owner]


def main(argv: list[str] | None = None) -> int:
    """Write it, or say what is not up to date: 1."""
    parser = ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--check", action="store_true")
    if not parser.parse_args(argv).check:
        for function in FUNCTIONS:
            function.place.write_bytes(function.prepare())
            print(f"{function.place}: {function.place.stat().st_size} bytes")
    old = [function.place.name for function in FUNCTIONS if function.prepared() is None]
    if old:
        print(f"{', '.join(old)}: of other sources, make prepared")
    return int(bool(old))


if __name__ == "__main__":
    sys.exit(main())
