"""`gril doctor`: what is installed here, and what works."""

from dataclasses import dataclass

from gril_jax.config.command_line import parse

from ..arguments import Work, echo
from ..verb import Verb


@dataclass(frozen=True)
class _Options:
    timeout_s: float = 120.0
    """Time limit of each check, seconds."""


def _plan(args: list[str]) -> Work:
    about = "Check what is installed and what works on this machine."
    given = parse(_Options, args, prog="gril doctor", description=about)

    def work() -> int:
        from .. import doctor

        checks = doctor.check_all(timeout_s=given.timeout_s)
        echo(doctor.table(checks))
        return doctor.exit_code(checks)

    return work


VERB = Verb("doctor", "what is installed and what works on this machine", _plan)
