"""The lock of a run's folder: a file `lock`, held by the one process that writes there.

The file holds that process's id. The kernel drops the lock with the process, however it ends, so
that none is ever left behind; the file is. JAX is not imported here.
"""

import fcntl
import os
from pathlib import Path
from typing import TextIO

from gril_jax.errors import RunError


def take_lock(folder: Path, *, note: bool = True) -> TextIO:
    """Opens and locks the file `lock` of a folder; it stays locked until it is closed.

    Args:
      note: whether to write this process's id into the file.

    Raises:
      RunError: a process has the lock, this one included.
      OSError: the file cannot be made or written.
    """
    lock = open(folder / "lock", "a+", encoding="utf-8")  # closed by the caller
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.seek(0)
        holder = lock.read().strip() or "unknown"
        lock.close()
        raise RunError(
            f"{folder} is being written by process {holder}: wait for it or give another folder"
        ) from None
    if note:
        lock.truncate(0)
        lock.write(f"{os.getpid()}\n")
        lock.flush()
    return lock
