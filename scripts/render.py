"""Same as `softrobot render`."""

import sys

from softrobot_env.cli import main

sys.exit(main(["render", *sys.argv[1:]]))
