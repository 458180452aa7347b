"""Where a process can be reached."""

import psutil


def addresses(process: psutil.Process) -> set[str]:
    """Of all that it and those that it started listen at."""
    each = [process, *process.children(recursive=True)]
    return {at.laddr.ip for one in each for at in one.net_connections("inet") if at.status == psutil.CONN_LISTEN}
