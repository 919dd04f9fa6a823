"""`python -m pypose_lite.go1`: what a robot's owner does from the command line.

`options` is what it takes, `commands` what it does, `description` how a robot is told as a table
or as JSON, `velocities` where commands from other programs come from, `walking` the walk.
"""
