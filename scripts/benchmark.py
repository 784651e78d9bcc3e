"""Same as `softrobot benchmark`."""

import sys

from softrobot_env.cli import main

sys.exit(main(["benchmark", *sys.argv[1:]]))
