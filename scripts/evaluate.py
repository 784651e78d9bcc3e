"""Same as `softrobot evaluate`."""

import sys

from softrobot_env.cli import main

sys.exit(main(["evaluate", *sys.argv[1:]]))
