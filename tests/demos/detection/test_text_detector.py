"""Detection by words: real classes of transformers, loaded from a folder as a user's would be."""

import numpy as np
import pytest
from support import tiny_text_models

from gril_jax.demos.detection.sightings import LEAST_SCORE
from gril_jax.demos.detection.text_detector import text_detector, words_as_names
from gril_jax.errors import DemoError

MISSING = "needs the extra 'detect': pip install 'gril-jax[detect]'"
NAMES = ("red cup", "coaster", "hand")


@pytest.fixture(autouse=True)
def packages():
    for name in ("torch", "transformers", "PIL"):
        pytest.importorskip(name, reason=MISSING)


@pytest.fixture
def frames():
    return np.random.default_rng(0).integers(0, 255, (3, 48, 80, 3), np.uint8)


def test_an_owl_finds_what_its_own_library_finds(tmp_path, frames):
    import torch

    model, processor = tiny_text_models.save_owl(tmp_path / "owl")
    detector = text_detector(NAMES, str(tmp_path / "owl"))
    found = detector(frames)
    assert len(found) == 3
    other = text_detector(["red cup", "spoon", "hand"], str(tmp_path / "owl"))
    assert other.key != detector.key  # so that boxes that are kept are not those of other words
    words = [[f"a photo of a {name}" for name in NAMES]]
    for frame, sightings in zip(frames, found, strict=True):
        inputs = processor(images=[frame], text=words, return_tensors="pt")
        with torch.inference_mode():
            (row,) = processor.post_process_grounded_object_detection(
                model.eval()(**inputs), threshold=LEAST_SCORE, target_sizes=[(48, 80)]
            )
        best = int(row["scores"].argmax())
        first = max(sightings, key=lambda one: one.score)
        assert first.name == NAMES[int(row["labels"][best])]
        assert first.score == pytest.approx(float(row["scores"][best]), abs=1e-5)
        edges = np.clip(row["boxes"][best].numpy(), 0, [80, 48] * 2)
        np.testing.assert_allclose(first.edges, edges, atol=1e-3)


@pytest.mark.parametrize("kind", ["GroundingDino", "MMGroundingDino"])
def test_a_grounding_detector_scores_each_name_by_its_own_words(tmp_path, frames, kind):
    import torch

    model, processor = tiny_text_models.save_grounding(tmp_path / "dino", kind)
    detector = text_detector(NAMES, str(tmp_path / "dino"))
    found = detector(frames)
    inputs = processor(images=[*frames], text=[[*NAMES]] * 3, return_tensors="pt")
    tokens = processor.tokenizer.convert_ids_to_tokens(inputs["input_ids"][0].tolist())
    assert tokens == ["[CLS]", "red", "cup", ".", "coaster", ".", "hand", ".", "[SEP]"]
    with torch.inference_mode():
        outputs = model.eval()(**inputs)
    words = outputs.logits.sigmoid().numpy()
    scores = np.stack([words[..., [1, 2]].mean(-1), words[..., 4], words[..., 6]], axis=-1)
    for frame, sightings in enumerate(found):
        best = int(scores[frame].max(-1).argmax())
        first = max(sightings, key=lambda one: one.score)
        assert first.name == NAMES[int(scores[frame, best].argmax())]
        assert first.score == pytest.approx(scores[frame, best].max(), abs=1e-4)
        x, y, wide, high = outputs.pred_boxes[frame, best].numpy() * [80, 48, 80, 48]
        edges = [x - wide / 2, y - high / 2, x + wide / 2, y + high / 2]
        np.testing.assert_allclose(first.edges, np.clip(edges, 0, [80, 48] * 2), atol=0.01)


def test_a_full_stop_in_a_name_does_not_part_it_and_what_is_no_word_is_a_sentence(tmp_path, frames):
    tiny_text_models.save_grounding(tmp_path / "dino")
    detector = text_detector(["Red. cup", "hand"], str(tmp_path / "dino"))
    assert {one.name for row in detector(frames) for one in row} <= {"Red. cup", "hand"}
    with pytest.raises(DemoError, match="names to detect are 2, but the model read 1"):
        text_detector(["...", "hand"], str(tmp_path / "dino"))(frames)


def test_a_model_that_is_not_there_or_is_another_is_one_sentence(tmp_path, monkeypatch):
    import transformers

    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    (tmp_path / "empty").mkdir()
    transformers.BertConfig(hidden_size=32, num_attention_heads=2).save_pretrained(tmp_path / "b")
    (tmp_path / "file").write_text("")
    for model, words in {
        str(tmp_path / "none"): "is no folder of a model; it must hold config.json",
        str(tmp_path / "file"): "is no folder of a model",
        str(tmp_path / "empty"): "this folder holds no open-vocabulary detector",
        str(tmp_path / "b"): "this folder holds no open-vocabulary detector",
        "nobody/no-such-model": "there is no such folder, and no open-vocabulary detector that",
    }.items():
        with pytest.raises(DemoError) as raised:
            text_detector(["cup"], model)
        said = str(raised.value)
        assert words in said, said
        assert "\n" not in said
        assert len(said) < 500


def test_weights_that_would_run_code_are_not_read(tmp_path):
    """Pickled weights, in place of safetensors."""
    import torch

    model, _ = tiny_text_models.save_owl(tmp_path / "owl")
    (tmp_path / "owl" / "model.safetensors").unlink()
    torch.save(model.state_dict(), tmp_path / "owl" / "pytorch_model.bin")
    with pytest.raises(DemoError, match="this folder holds no open-vocabulary detector"):
        text_detector(["cup"], str(tmp_path / "owl"))


def test_the_score_of_a_name_is_the_mean_of_its_words():
    words = np.array([[0.0, 0.9, 0.1, 0.9]])
    np.testing.assert_allclose(words_as_names(words, [[0, 1], [2], [3]]), [[0.45, 0.1, 0.9]])
