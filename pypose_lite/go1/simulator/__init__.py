"""A simulated Go1, in this program or as one of its own (`__main__`), and a recorded one."""
