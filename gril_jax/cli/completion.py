"""Scripts that let the Tab key of a shell finish verbs, configurations and options of gril."""

from gril_jax.config import RunConfig
from gril_jax.config.command_line import options
from gril_jax.config.files import names

from . import verbs
from .arguments import SHORTCUTS

SHELLS = ("bash", "zsh", "fish")

# Verbs whose options are those of a whole configuration.
_WHOLE = ("train", "pretrain", "quickstart", "sweep", "demos make")
_MORE = ("--resume", "--hard-negatives", "--dry-run", "--help", "--help-all")

_BASH = """\
_gril() {
    local word=${COMP_WORDS[COMP_CWORD]} verb=${COMP_WORDS[1]} words
    case $COMP_CWORD:$verb in
        1:*) words="@FIRST@" ;;
@SECOND@
        *:@WHOLE@) words="@OPTIONS@"; [ "$COMP_CWORD" = 2 ] && words="$words @CONFIGS@" ;;
        *) words="--help" ;;
    esac
    COMPREPLY=($(compgen -W "$words" -- "$word"))
    [ ${#COMPREPLY[@]} -gt 0 ] || COMPREPLY=($(compgen -f -- "$word"))
}
complete -o filenames -F _gril gril
"""


def script(shell: str) -> str:
    """The script, to be run by the shell when it starts; words are those of this version."""
    return _fish() if shell == "fish" else _bash(shell)


def _words() -> tuple[dict[str, list[str]], list[str]]:
    """The second words of each first one, which may be none, and the options of a whole run."""
    known: dict[str, list[str]] = {}
    for name in verbs.names():
        first, _, second = name.partition(" ")
        known.setdefault(first, []).extend([second] if second else [])
    return known, [*SHORTCUTS, *_MORE, *options(RunConfig)]


def _files() -> list[str]:
    """The configurations and studies that are shipped."""
    from gril_jax.workflows.study import recipe

    return [*names(), *recipe.names()]


def _bash(shell: str) -> str:
    known, every = _words()
    second = "\n".join(
        f'        2:{first}) words="{" ".join(rest)}" ;;' for first, rest in known.items() if rest
    )
    parts = {
        "FIRST": " ".join(known), "SECOND": second, "OPTIONS": " ".join(every),
        "WHOLE": "|*:".join(name.split()[0] for name in _WHOLE), "CONFIGS": " ".join(_files()),
    }  # fmt: skip
    text = _BASH
    for name, words in parts.items():
        text = text.replace(f"@{name}@", words)
    return f"autoload -U +X bashcompinit && bashcompinit\n{text}" if shell == "zsh" else text


def _fish() -> str:
    known, every = _words()
    lines = [f"complete -c gril -n __fish_use_subcommand -f -a '{' '.join(known)}'"]
    for first, rest in known.items():
        if rest:
            here = f"__fish_seen_subcommand_from {first}"
            lines.append(f"complete -c gril -n '{here}' -f -a '{' '.join(rest)}'")
    here = f"__fish_seen_subcommand_from {' '.join(name.split()[0] for name in _WHOLE)}"
    lines.append(f"complete -c gril -n '{here}' -a '{' '.join(_files())}'")
    lines += [f"complete -c gril -n '{here}' -l {option[2:]}" for option in every]
    return "\n".join(lines) + "\n"
