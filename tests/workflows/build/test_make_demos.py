"""A demonstration set of shoes in the box: small pictures, few episodes."""

import io

import numpy as np
import pytest
from gril_jax.envs.base import ExpertError, Wanted
from gril_jax.envs.tabletop import demonstrations, render
from gril_jax.envs.tabletop.recorded import Script
from gril_jax.envs.tabletop.tasks.shoes_in_box import ENTRY, SCRIPT
from gril_jax.envs.user_tasks import files
from support import own_task

from gril_jax.config import DemosConfig, EnvConfig, MakeDemosConfig
from gril_jax.demos.demo_set import demo_batch, load_demo_set
from gril_jax.demos.vision.video import read_video
from gril_jax.errors import ConfigError, DemoError
from gril_jax.runs.progress import Progress
from gril_jax.workflows.build import make_demos

PIXELS = 64


def _make(folder, num, num_failures, seed):
    chosen = DemosConfig(num=num, num_validation=1, num_failures=num_failures)
    config = MakeDemosConfig(env=EnvConfig(name="shoes_in_box"), demos=chosen)
    with Progress(stream=io.StringIO()) as progress:
        return make_demos.make(config, folder, progress, seed=seed)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shoes") / "demos"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demonstrations, "_PIXELS", PIXELS)
        try:
            return folder, _make(folder, num=2, num_failures=2, seed=1)
        except DemoError as error:
            pytest.skip(str(error))


def test_a_set_has_successes_and_failures_named_after_their_kind(made):
    folder, report = made
    demos = load_demo_set(folder)
    assert [e.name for e in demos] == [
        *("000_success", "001_success", "002_success", "003_lid_only", "004_one_shoe")
    ]
    assert [e.outcome for e in demos] == ["success"] * 3 + ["failure"] * 2
    assert report == demos
    assert (demos.task, demos.half_extent, demos.fps) == ("shoes_in_box", 1.0, 20.0)
    assert demos.objects(demos[0]) == list(demos.classes)
    success, _, _, lid_only, _ = (e.stages for e in demos)
    assert [*success] == ["lid open", "shoe A in", "shoe B in"]
    assert 0 < success["lid open"] < min(success["shoe A in"], success["shoe B in"])
    assert max(success.values()) < len(demos[0])
    assert lid_only["lid open"] > 0
    assert lid_only["shoe A in"] == lid_only["shoe B in"] == -1


def test_frames_and_boxes_belong_together_in_units_of_the_picture(made):
    folder, _ = made
    demos = load_demo_set(folder)
    batch = demo_batch(demos)
    assert (np.abs(batch.center) <= 1).all()
    assert (batch.size <= 2).all()
    frames = read_video(folder / "000.mp4")
    assert frames.shape == (len(demos[0]), PIXELS, PIXELS, 3)
    # the middle of a shoe's box is brown in the first frame
    x, y = demos[0].tracks.center[0, demos.classes.index("shoe B")]
    red, _, blue = frames[0, int((1 - y) / 2 * PIXELS), int((1 + x) / 2 * PIXELS)].astype(int)
    assert red > blue + 20


def test_in_a_success_the_lid_moves_first_and_both_shoes_end_in_the_box(made):
    folder, _ = made
    demos = load_demo_set(folder)
    center, size = demos[0].tracks.center, demos[0].tracks.size
    box, lid, *shoes = (demos.classes.index(n) for n in ("box", "lid", "shoe A", "shoe B"))
    away = np.linalg.norm(center - center[0], axis=-1) > 0.1
    for shoe in shoes:
        assert away[:, lid].argmax() < away[:, shoe].argmax()
        assert (np.abs(center[-1, shoe] - center[-1, box]) < size[-1, box] / 2).all()


def test_without_opengl_no_demonstration_is_begun(tmp_path, monkeypatch):
    def missing(*_, **__):
        raise RuntimeError("no OpenGL works here")

    monkeypatch.setattr(demonstrations, "Renderer", missing)
    assert render.Renderer is not demonstrations.Renderer
    with pytest.raises(DemoError, match="no OpenGL works here"):
        _make(tmp_path / "set", num=2, num_failures=0, seed=0)
    assert not (tmp_path / "set").exists()


def test_an_expert_that_always_fails_is_given_up():
    class Hopeless(Script):
        def as_meant(self, run):
            return False

    shown = Hopeless(*SCRIPT)
    with pytest.raises(ExpertError, match="played 0 of 1 demonstrations"):
        demonstrations.play(ENTRY.make(), shown, Wanted(1, 0, 0, "layout"), print)


@pytest.mark.parametrize(
    ("variant", "asked", "places"),
    [("demo", None, "layout"), ("jitter", None, "jitter"), ("all", None, "layout")]
    + [("jitter", "demo", "demo")],
)
def test_the_expert_begins_in_jitter_if_the_task_does_and_elsewhere_if_not(
    variant, asked, places, tmp_path, monkeypatch
):
    def refuse(build, wanted, _):
        raise ExpertError(f"asked to begin in {wanted.places}")

    monkeypatch.setattr(make_demos.envs, "demonstrate", lambda name: refuse)
    config = MakeDemosConfig(env=EnvConfig(variant=variant))
    with (
        Progress(stream=io.StringIO()) as progress,
        pytest.raises(DemoError, match=f"asked to begin in {places}"),
    ):
        make_demos.make(config, tmp_path / "set", progress, variant=asked)


@pytest.mark.parametrize("asked", [None, "layout"])
def test_a_task_of_one_s_own_begins_in_the_variant_that_is_asked_for(asked, tmp_path, monkeypatch):
    own_task.home(tmp_path, monkeypatch)
    made = "speed=1.0):", 'variant="easy"):\n    raise ValueError("it is " + variant)'
    env = EnvConfig(name=f"{own_task.write(tmp_path, name='varied.py', made=made)}:make")
    files.name(env.name)
    with (
        Progress(stream=io.StringIO()) as progress,
        pytest.raises(ConfigError, match=f"it is {asked or 'easy'}"),
    ):
        make_demos.make(MakeDemosConfig(env=env), tmp_path / "set", progress, variant=asked)
    plain = EnvConfig(name=f"{own_task.write(tmp_path)}:make")
    files.name(plain.name)
    with (
        Progress(stream=io.StringIO()) as progress,
        pytest.raises(DemoError, match=r"the variant is layout, but .* takes no option variant"),
    ):
        make_demos.make(MakeDemosConfig(env=plain), tmp_path / "set", progress, variant="layout")


def test_labels_that_differ_between_episodes_are_refused(tmp_path, monkeypatch):
    own_task.home(tmp_path, monkeypatch)
    swapped = "jnp.arange(3),", "jnp.where(puck[0] > 0, jnp.arange(3), jnp.array([2, 1, 0])),"
    name = f"{own_task.write(tmp_path, name='swapped.py', change=swapped)}:make"
    files.name(name)
    config = MakeDemosConfig(
        env=EnvConfig(name=name), demos=DemosConfig(num=6, num_validation=2, num_failures=0)
    )
    with (
        Progress(stream=io.StringIO()) as progress,
        pytest.raises(DemoError, match="label differs between the task's episodes"),
    ):
        make_demos.make(config, tmp_path / "set", progress)
