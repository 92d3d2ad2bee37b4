"""``python -m granpipe``, and the command ``granpipe``."""

import signal


def start() -> None:
    """Import the command line and call it; Ctrl-C meanwhile ends the process at once, for nothing has begun."""
    own = signal.getsignal(signal.SIGINT)
    if own is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from granpipe.cli import main

    signal.signal(signal.SIGINT, own)
    main()


if __name__ == "__main__":
    start()
