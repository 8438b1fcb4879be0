"""A process whose every attempt to reach another host fails, and is remembered."""

import contextlib
import socket

import pytest


@contextlib.contextmanager
def no_network():
    """Yields the list of attempts; sockets within the machine's own files still work."""
    attempts = []

    def refused(*args, **kwargs):
        attempts.append(args)
        raise OSError(101, "Network is unreachable")

    class Cut(socket.socket):
        def connect(self, address):
            return super().connect(address) if self._is_local() else refused(address)

        def connect_ex(self, address):
            return super().connect_ex(address) if self._is_local() else refused(address)

        def sendto(self, *args):
            return super().sendto(*args) if self._is_local() else refused(*args)

        def _is_local(self):
            return self.family == socket.AF_UNIX

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(socket, "socket", Cut)
        for name in ("getaddrinfo", "gethostbyname", "gethostbyname_ex", "create_connection"):
            patch.setattr(socket, name, refused)
        yield attempts
