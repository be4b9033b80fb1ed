"""``python -m stridelab.cli``: the command line."""

from stridelab.cli.app import main

main()
