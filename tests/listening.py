"""The network addresses at which a process can be reached."""

from contextlib import suppress

import psutil


def addresses(process: psutil.Process) -> set[str]:
    """The addresses at which a process or its children listen."""
    listening: set[str] = set()
    for started in [process, *process.children(recursive=True)]:
        with suppress(psutil.NoSuchProcess):  # it has ended since
            listening |= {
                at.laddr.ip
                for at in started.net_connections("inet")
                if at.status == psutil.CONN_LISTEN
            }
    return listening
