"""The subcommands of `softrobot`: each adds its arguments to a parser and runs."""
