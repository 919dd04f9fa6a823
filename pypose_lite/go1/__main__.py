"""`python -m pypose_lite.go1 walk --robot udp://127.0.0.1:8082`: the Go1 from the command line."""

import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command and returns the program's exit status.

    Whatever ends it (Ctrl-C at any time, a robot that falls silent, a file that is none) is told
    in one line.
    """
    try:
        from .program.options import parsed

        options = parsed(arguments)
        from .program import commands

        return commands.run(options)
    except KeyboardInterrupt:
        print("\nstopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever read what it prints has gone
        return 1
    except (RuntimeError, ValueError, OSError) as error:
        print(f"{error}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
