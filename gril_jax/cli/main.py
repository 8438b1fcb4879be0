"""`gril VERB`: the command line.

The command line is read, and every path on it looked at, before anything heavy is imported. Exit
codes: 0 done, 1 failed at work, 2 a wrong command line, 128 and the number of a signal that came.
"""

import errno
import io
import os
import signal
import sys
import textwrap
from collections.abc import Sequence
from importlib import metadata

from gril_jax.config.command_line import nearest
from gril_jax.envs.user_tasks.files import TaskError
from gril_jax.errors import ConfigError, GrilError, printable
from gril_jax.runs.interrupt import Interrupted, heard

from . import verbs
from .arguments import Work

_INDENT = 30
_USAGE = """\
usage: gril VERB [options]

Learn a reward from demonstration videos without actions, and a policy from the reward.
"""
_NOTE = """
CONFIG is the name of a shipped configuration or the path of a YAML file; RUN is the folder
that a run made. `gril VERB --help` lists the options of a verb, `gril --version` says which gril
this is, and `gril --tyro-print-completion SHELL` prints what lets the Tab key finish words.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a command line and returns the exit code; `argv` defaults to `sys.argv`."""
    args = list(sys.argv[1:] if argv is None else argv)
    make_printable(sys.stdout, sys.stderr)
    code = 2
    try:
        with heard():
            work = _plan(args)
            code = 1
            result = work() or 0
        if sys.stdout is not None:  # as where a caller has closed it
            sys.stdout.flush()  # here, where a pipe that is closed can still be answered for
        return result
    except Interrupted as stop:
        _tell(str(stop))
        return stop.exit_code
    except (GrilError, TaskError) as error:
        _tell(str(error))
        # What only the task or the devices can refuse is known later, but is a wrong command too.
        return 2 if isinstance(error, ConfigError) else code
    except KeyboardInterrupt:
        if argv is None:  # another one ends the process at once, and says nothing more
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        _tell("interrupted")
        return 130
    except SystemExit as stop:  # tyro has printed the help
        if isinstance(stop.code, str):  # of a user's own code
            _tell(stop.code)
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except BrokenPipeError:  # the reader of a pipe has had enough, as in `gril --help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (OSError, MemoryError, RuntimeError) as error:
        system = isinstance(error, OSError)
        said = _of_the_system(error) if system else _of_memory(error) or _of_a_callback(error)
        if said is None:
            raise
        _tell(said)
        return code


def _tell(sentence: str) -> None:
    """Says why a command ends, in one line of standard error."""
    print(f"gril: {printable(' '.join(sentence.splitlines())).rstrip('.')}.", file=sys.stderr)


def make_printable(*streams: object) -> None:
    """Lets streams write an escape for a letter that they lack, as a pipe in ASCII lacks most.

    All that is said goes through them: sentences, progress, help and reports."""
    for stream in streams:
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


# What a machine refuses a program that makes no mistake.
_REFUSED = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO),
    *(errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ESTALE, errno.EBADF),
}


def _of_the_system(error: OSError) -> str | None:
    """A sentence without its full stop on what the system refuses; None for what is a mistake."""
    if error.errno == errno.ENAMETOOLONG:
        return f"{error.filename!s:.60}... is too long for a file's name"
    if error.errno not in _REFUSED:
        return None
    if error.filename is None:
        return f"the machine refuses what is to be written or read ({error.strerror})"
    return f"{error.filename!s} cannot be written or read ({error.strerror})"


def _of_memory(error: Exception) -> str | None:
    """The same on memory, of the machine or of a GPU, where it is that."""
    text = str(error)
    if not isinstance(error, MemoryError) and not any(words in text for words in _NO_MEMORY):
        return None
    return (
        "there is not enough memory for this: end what else uses the device, or lower "
        "--ppo.num-envs or --seeds (a run that has begun goes on with --resume)"
    )


def _of_a_callback(error: Exception) -> str | None:
    """The same on Python code that a task calls while JAX runs it, where it is that: XLA gives its
    whole traceback."""
    lines = str(error).strip().splitlines()
    if not any("Traceback (most recent call last)" in line for line in lines):
        return None
    return f"the task's own Python code failed while JAX ran it ({lines[-1].strip():.200})"


# As XLA, CUDA and Warp say it.
_NO_MEMORY = ("RESOURCE_EXHAUSTED", "Out of memory", "out of memory")


def help_page() -> str:
    """The help of `gril` itself, from what the verbs say of themselves."""
    page = _USAGE
    for title, members in verbs.table().items():
        lines = (line for verb in members for line in verb.lines.items())
        page += f"\n{title}:\n" + "".join(_told(*line) for line in lines)
    return page + _NOTE


def _told(usage: str, text: str) -> str:
    left, right = f"  {usage}  ".ljust(_INDENT), " " * _INDENT
    how = {"initial_indent": left, "subsequent_indent": right, "break_on_hyphens": False}
    return textwrap.fill(text, 100, **how) + "\n"


def _plan(args: list[str]) -> Work:
    """Parses the command line; nothing heavy is imported here."""
    if args[:1] in (["--version"], ["-V"]):
        print(f"gril-jax {metadata.version('gril-jax')}")
        return lambda: 0
    if args[:1] == [verbs.COMPLETION]:
        verbs.print_completion(args[1:])
    known = {verb.name: verb for verb in verbs.every()}
    families = {name.partition(" ")[0] for name in known if " " in name}
    size = 2 if args and args[0] in families else 1
    words, rest = args[:size], args[size:]
    if len(words) < size or words[-1] in ("-h", "--help"):
        print(help_page(), end="")
        return lambda: 0
    if (name := " ".join(words)) not in known:
        raise ConfigError(f"there is no verb {name!r}{nearest(name, known)}: see gril --help")
    return known[name].plan(rest)


if __name__ == "__main__":
    sys.exit(main())
