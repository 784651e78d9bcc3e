"""`python -m softrobot_env`: the same as `softrobot`."""

import sys

from softrobot_env.cli import main

sys.exit(main())
