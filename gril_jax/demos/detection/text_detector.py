"""A detector that looks for whatever words name, by a model of Hugging Face's `transformers`.

    detect = text_detector(["cup", "coaster"], "google/owlv2-base-patch16-ensemble")
    detect(frames)            # for each frame its sightings

Models are OWL-ViT and OWLv2, Grounding DINO and its successors such as LLMDet. Each takes all words
and several frames at once, which the library's own pipeline does a word and a frame at a time.
"""

import importlib
import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from gril_jax.errors import ConfigError, DemoError

from .sightings import LEAST_SCORE, Sighting, best_of

USUAL = "google/owlv2-base-patch16-ensemble"  # Apache-2.0
_PACKAGES = ("torch", "transformers", "PIL")
_OWL = ("owlvit", "owlv2")
_GROUNDING = ("grounding-dino", "mm-grounding-dino")  # LLMDet is of the second
_TOGETHER = {"cuda": 8, "mps": 4, "cpu": 2}  # frames at once
_LONGEST = 150  # letters of what a library says


def require_installed() -> None:
    """Raises ConfigError if the packages of the extra are not there."""
    for package in _PACKAGES:
        if importlib.util.find_spec(package) is None:
            raise ConfigError(
                f"detection by words needs {package}, which is not installed: "
                "pip install 'gril-jax[detect]'"
            )


@dataclass(frozen=True)
class TextDetector:
    """A model with the words it looks for; a call finds boxes in frames."""

    names: Sequence[str]
    key: str  # tells it from others
    model: Any  # of transformers
    processor: Any
    together: int  # frames at once

    def __call__(self, frames: UInt8[np.ndarray, "T H W 3"]) -> list[list[Sighting]]:
        """The sightings in each frame."""
        torch = importlib.import_module("torch")
        height, width = frames.shape[1:3]
        owl = self.model.config.model_type in _OWL
        words = [f"a photo of a {name}" if owl else name for name in self._words]
        # Pictures as lists of the library: a stack of arrays could be taken for a video.
        given = {"images": [*frames], "text": [words] * len(frames)}
        inputs = self.processor(**given, return_tensors="pt").to(self.model.device)
        try:
            with torch.inference_mode():
                outputs = self.model(**inputs)
        except RuntimeError as error:  # such as a GPU's memory that is full
            said = " ".join(str(error).split())[:_LONGEST]
            name, _, _ = self.key.partition(",")
            raise DemoError(f"{name}: failed on frames of {width} x {height} ({said}).") from error
        read = self._owl if owl else self._grounding
        found = read(outputs, inputs, (height, width))
        return [best_of(*one, self.names, width, height) for one in found]

    @property
    def _words(self) -> list[str]:
        """The names as the models have learned words: in small letters, and without full stops,
        which part one name from the next."""
        return [" ".join(name.lower().replace(".", " ").split()) for name in self.names]

    def _owl(self, outputs: Any, inputs: Any, size: tuple[int, int]) -> list[tuple]:
        sizes = [size] * len(outputs.logits)
        rows = self.processor.post_process_grounded_object_detection(
            outputs, threshold=LEAST_SCORE, target_sizes=sizes
        )
        found = []
        for row in rows:
            label, score = row["labels"].cpu().numpy(), row["scores"].cpu().numpy()
            scores = np.zeros((len(label), len(self.names)))
            scores[np.arange(len(label)), label] = score
            found.append((row["boxes"].cpu().numpy().astype(float), scores))
        return found

    def _grounding(self, outputs: Any, inputs: Any, size: tuple[int, int]) -> list[tuple]:
        spans = self._spans(inputs["input_ids"][0].tolist())
        words = outputs.logits.sigmoid().cpu().numpy().astype(float)
        scores = words_as_names(words, spans)
        boxes = outputs.pred_boxes.cpu().numpy().astype(float)
        middle, half = boxes[..., :2], boxes[..., 2:] / 2
        edges = np.concatenate([middle - half, middle + half], axis=-1)
        return [*zip(edges * np.array([*size[::-1]] * 2), scores, strict=True)]

    def _spans(self, tokens: Sequence[int]) -> list[list[int]]:
        """The places of each name among the tokens, which full stops part."""
        tokenizer = self.processor.tokenizer
        stop = tokenizer.convert_tokens_to_ids(".")
        spans: list[list[int]] = [[]]
        for at, token in enumerate(tokens):
            if token == stop:
                spans.append([])
            elif token not in tokenizer.all_special_ids:
                spans[-1].append(at)
        found = [span for span in spans if span]
        if len(found) != len(self.names):
            raise DemoError(
                f"the names to detect are {len(self.names)}, but the model read {len(found)}: "
                f"write them in plain words, not {', '.join(self.names)[:_LONGEST]}."
            )
        return found


def words_as_names(
    words: Float[np.ndarray, "... W"], spans: Sequence[Sequence[int]]
) -> Float[np.ndarray, "... C"]:
    """The score of each name: the mean of those of its words.

    The best word would do for one name, but not for a red cup beside a blue one.

    >>> words_as_names(np.array([0.0, 0.9, 0.1, 0.9]), [[0, 1], [2, 3]]).tolist()
    [0.45, 0.5]
    """
    return np.stack([words[..., [*span]].mean(axis=-1) for span in spans], axis=-1)


def text_detector(names: Sequence[str], model: str | None) -> TextDetector:
    """The detector of a model, by the name of its repository on Hugging Face or its folder; on a
    GPU if there is one.

    Raises:
      ConfigError: the extra is not installed.
      DemoError: the model is not there, cannot be had, or finds nothing by words.
    """
    require_installed()
    name = USUAL if model is None else model
    folder = Path(name)
    if not folder.is_dir() and (folder.exists() or name.startswith((".", "/", "~"))):
        raise DemoError(f"{name}: is no folder of a model; it must hold config.json and weights.")
    torch = importlib.import_module("torch")
    transformers = importlib.import_module("transformers")
    transformers.utils.logging.set_verbosity_error()
    net = _loaded(name, transformers.AutoModelForZeroShotObjectDetection.from_pretrained,
                  use_safetensors=True)  # fmt: skip
    kind = net.config.model_type
    if kind not in (*_OWL, *_GROUNDING):
        raise DemoError(f"{name}: is a {kind}; it must be {', '.join((*_OWL, *_GROUNDING))}.")
    processor = _loaded(name, transformers.AutoProcessor.from_pretrained)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    if device == "cpu" and torch.backends.mps.is_available():
        device = "mps"
    return TextDetector(
        [*names], f"{name}, {kind}{_state(folder)}, {', '.join(names)}", net.to(device).eval(),
        processor, _TOGETHER[device],
    )  # fmt: skip


def _state(folder: Path) -> str:
    """Tells the files in a folder from those that it had before; nothing of a model's name."""
    files = sorted(folder.glob("*")) if folder.is_dir() else []
    return "".join(f", {file.name} {file.stat().st_size} {file.stat().st_mtime_ns}"
                   for file in files if file.is_file())  # fmt: skip


def _loaded(name: str, load: Callable[..., Any], **options: Any) -> Any:
    try:
        return load(name, **options)
    except Exception as error:  # of three libraries and the network
        said = " ".join(str(error).split())[:_LONGEST] or type(error).__name__
        where = "this folder holds no" if Path(name).is_dir() else "there is no such folder, and no"
        raise DemoError(
            f"{name}: {where} open-vocabulary detector that transformers can load, or the network "
            f"is not there ({said})."
        ) from error
