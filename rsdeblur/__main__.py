"""`python -m rsdeblur`: the command line."""

from rsdeblur.cli import main

main(prog_name="rsdeblur")
