"""The entry point of `flightd`; it imports the rest where a Ctrl-C is caught."""

import sys

INTERRUPTED = 130


def main() -> None:
    """Run the command line."""
    try:
        from daemon.cli import commands, output

        output.prepare()
        commands.build(sys.argv[1] if len(sys.argv) > 1 else None)(prog_name="flightd")
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
