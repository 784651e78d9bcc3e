"""Same as `softrobot train`."""

import sys

from softrobot_env.cli import main

sys.exit(main(["train", *sys.argv[1:]]))
