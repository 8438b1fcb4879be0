"""`gril VERB`: exit codes, one sentence for each mistake, nothing heavy before the work."""

import gc
import io
import os
import subprocess
import sys
from pathlib import Path

import jax
import pytest

from gril_jax.cli import heavy_imports, main, verbs

# Runs a command line as `gril` does, then tells which of the slow packages it loaded.
_RUNNER = """
import sys
from gril_jax.cli.main import main
code = main(sys.argv[1:])
heavy = [m for m in ("jax", "mujoco", "brax", "orbax", "numpy", "rich") if m in sys.modules]
print("HEAVY", *heavy)
sys.exit(code)
"""


def _gril(*args, cwd):
    """Exit code, stdout and stderr of a process of its own, which must not load JAX."""
    done = subprocess.run(
        [sys.executable, "-c", _RUNNER, *args], capture_output=True, text=True, cwd=cwd
    )
    out, _, heavy = done.stdout.rpartition("HEAVY")
    assert heavy.split() == []
    assert "Traceback" not in done.stderr
    return done.returncode, out, done.stderr


# --- a process of its own


@pytest.mark.parametrize(
    ("args", "shows"),
    [
        ([], "usage: gril VERB"),
        (["demos", "--help"], "import-videos"),
        (["train", "match_regions", "-h"], "12000000"),
        (["quickstart", "--help"], "--ppo.num-timesteps 7000000"),
        (["pretrain", "--help", "loss"], "Weight of the loss on perturbed frames"),
        (["demos", "make", "--help"], "--num-validation"),
        (["demos", "import-videos", "--help"], "--half-extent"),
        (["eval", "--help"], "--episodes"),
        (["export", "--help"], "policy.npz"),
        (["sweep", "--help"], "--seeds"),
        (["sweep", "table1", "--help"], "--rows"),
        (["subtasks", "--help"], "--sets"),
        (["bench", "env", "--help"], "--num-envs"),
        (["--tyro-print-completion", "bash"], "complete"),
    ],
)
def test_help_is_printed_without_loading_anything_heavy(args, shows, tmp_path):
    code, out, err = _gril(*args, cwd=tmp_path)
    assert (code, err) == (0, "")
    assert shows in out


@pytest.mark.parametrize(
    ("args", "fault"),
    [
        (["trian"], "there is no verb 'trian' (did you mean train?)"),
        (["demos", "mkae"], "there is no verb 'demos mkae' (did you mean demos make?)"),
        (["train", "--ppo.num-evs", "3"], "did you mean --ppo.num-envs?"),
        (["train", "quikstart"], "did you mean quickstart?"),
        (["train", "mine.yaml"], "mine.yaml does not exist"),
        (["quickstart", "match_regions"], "there is no use for 'match_regions'"),
        (["quickstart", "--demos", "nowhere"], "nowhere does not exist, but must be a folder"),
        (["pretrain", "--pool.alpha=0"], "pool.alpha is 0.0, but must be"),
        (["demos", "make", "quickstart"], "needs --out"),
        (["demos", "make", "--out"], "--out is given without a value, but must be None or a word"),
        (["demos", "make", "--out", "x", "--variant", "y"], "--variant is 'y', but must be one of"),
        (["audit", __file__, "--variant", "y"], "--variant is 'y', but must be one of"),
        (["demos", "import-videos", "nowhere", "--out", "x"], "nowhere does not exist"),
        (["demos", "import-videos"], "needs SOURCE, --out"),
        (["eval"], "gril eval needs RUN"),
        (["eval", "nowhere"], "nowhere does not exist, but must be the folder of a run"),
        (["report", "."], "has no config.yaml"),
        (["export"], "gril export needs RUN, --out"),
        (["export", "nowhere", "--out", "x"], "must be the folder of a run"),
        (["export", ".", "--out", "x", "--what", "y"], "--what is 'y', but must be one of reward"),
        (["doctor", "--timeout-s", "x"], "--timeout-s must be a number: could not convert"),
        (["--tyro-print-completion", "tcl"], "must be followed by one of bash, zsh, fish, tcsh"),
    ],
)
def test_a_mistake_is_one_sentence_and_exit_code_2_before_jax_is_imported(args, fault, tmp_path):
    code, out, err = _gril(*args, cwd=tmp_path)
    assert (code, out) == (2, "")
    assert err.startswith("gril: ")
    assert err.endswith(".\n")
    assert err.count("\n") == 1
    assert fault in err


def test_the_installed_command_runs(tmp_path):
    gril = Path(sys.executable).with_name("gril")
    if not gril.exists():
        pytest.skip("the package is on the path without having been installed")
    done = subprocess.run([gril, "--help"], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, main.help_page())


def test_a_reader_that_has_had_enough_causes_no_traceback(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    code = [sys.executable, "-m", "gril_jax.cli.main", "train", "--help"]
    done = subprocess.run(code, stdout=writer, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


# --- heavy imports


@pytest.mark.parametrize("value", ["1", "True", "on", "maybe", ""])
@pytest.mark.parametrize(
    "args", [["pretrain", "quickstart"], ["train", "quickstart"], ["demos", "make", "quickstart"]]
)
def test_float64_is_refused_before_anything_is_made(monkeypatch, tmp_path, capsys, args, value):
    monkeypatch.setenv("JAX_ENABLE_X64", value)
    assert main.main([*args, "--out", str(tmp_path / "new")]) == 2
    out, err = capsys.readouterr()
    said = f"JAX_ENABLE_X64 is {value!r}, but gril computes in float32: unset it, or set it to 0"
    assert (out, err) == ("", f"gril: {said}.\n")
    assert [*tmp_path.iterdir()] == []


def test_programs_that_are_not_compiled_are_refused_before_anything_is_made(monkeypatch, capsys):
    monkeypatch.setenv("JAX_DISABLE_JIT", "1")
    assert main.main(["pretrain", "quickstart"]) == 2
    said = "JAX_DISABLE_JIT is '1', but gril compiles its programs before it runs them: unset it"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("value", ["0", "false", "off"])
def test_float32_that_is_asked_for_is_no_fault(monkeypatch, tmp_path, value):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("JAX_ENABLE_X64", value)
    with heavy_imports.heavy_imports():
        pass


def test_what_an_import_prints_does_not_reach_stdout(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")  # so that its absence is restored
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    with heavy_imports.heavy_imports():
        print("an optional part is missing")
    assert capsys.readouterr().out == ""
    folder = tmp_path / "gril_jax" / "jax"
    assert folder.is_dir()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(folder)


def test_a_compilation_cache_that_the_user_chose_is_kept(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "mine")
    with heavy_imports.heavy_imports():
        assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "mine"


def test_without_a_writable_cache_the_work_goes_on(monkeypatch, tmp_path):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "")  # so that its absence is restored
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    with heavy_imports.heavy_imports():
        assert "JAX_COMPILATION_CACHE_DIR" not in os.environ


def test_garbage_is_looked_for_again_after_the_imports():
    def missing():
        assert not gc.isenabled()
        raise ImportError

    with pytest.raises(ImportError), heavy_imports.heavy_imports():
        missing()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


@pytest.mark.parametrize(
    ("platform", "said"),
    [
        ("cpu", "cpu"),
        ("nonsense", "JAX_PLATFORMS is 'nonsense', but JAX cannot use these: Unable to"),
    ],
)
def test_devices_are_taken_while_the_rest_is_imported(monkeypatch, tmp_path, platform, said):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("JAX_PLATFORMS", platform)
    code = (
        "from gril_jax.cli.heavy_imports import heavy_imports\n"
        "from gril_jax.errors import ConfigError\n"
        "try:\n"
        "    with heavy_imports(devices=True):\n"
        "        pass\n"
        "except ConfigError as error:\n"
        "    print(error)\n"
        "else:\n"
        "    from jax._src import xla_bridge\n"
        "    print(*xla_bridge._backends)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.startswith(said), done.stderr
    assert done.returncode == 0


def _too_large():
    jax.block_until_ready(jax.numpy.zeros((1 << 45,)))  # 128 TiB


def _of_warp():
    raise RuntimeError("Error launching kernel: Warp CUDA error 2: out of memory")


def _verb(work):
    return verbs.Verb("train", "trains", lambda rest: work)


@pytest.mark.parametrize("work", [_too_large, _of_warp])
def test_a_device_without_memory_left_is_one_sentence(monkeypatch, capsys, work):
    monkeypatch.setattr(verbs, "every", lambda: [_verb(work)])
    assert main.main(["train"]) == 1
    assert capsys.readouterr().err.startswith("gril: there is not enough memory for this: end what")


def test_a_mistake_of_the_program_keeps_its_traceback(monkeypatch):
    def broken():
        raise RuntimeError("a shape is wrong")

    monkeypatch.setattr(verbs, "every", lambda: [_verb(broken)])
    with pytest.raises(RuntimeError, match="a shape is wrong"):
        main.main(["train"])


# --- letters


@pytest.mark.parametrize(
    ("encoding", "errors", "shown"),
    [
        ("ascii", "strict", b"\\u2581 K\\xfcche"),
        ("latin-1", "strict", b"\\u2581 K\xfcche"),
        ("ascii", "surrogateescape", b"\\u2581 K\\xfcche"),
        ("ascii", "replace", b"? K?che"),  # as the user asked
        ("utf-8", "strict", "\u2581 K\xfcche".encode()),
    ],
)
def test_letters_that_a_stream_lacks_are_escaped(encoding, errors, shown):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding, errors)
    main.make_printable(stream, None, io.StringIO())
    print("\u2581 K\xfcche", end="", file=stream, flush=True)
    assert raw.getvalue() == shown
