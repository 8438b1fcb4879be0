"""The rows of an ablation of encoder training: each changes one choice alone."""

from typing import Any

_GRAPH = {"loss.decoder": "graph"}

ROWS: dict[str, dict[str, Any]] = {
    "as configured": {},
    "no reconstruction": {"loss.lambda_": 0.0},
    "lambda 0.1": {"loss.lambda_": 0.1},
    "lambda 10": {"loss.lambda_": 10.0},
    "temperature 0.1": {"loss.temperature": 0.1},
    "temperature 10": {"loss.temperature": 10.0},
    "alpha 1 (activity bits off)": {"pool.alpha": 1.0},
    "alpha 20": {"pool.alpha": 20.0},
    "no time agreement at first": {"loss.warmup": 0},
    "reconstruction from the latent": _GRAPH,
    "soft-DTW in place of TCC": {"loss.consistency": "soft_dtw"},
    "soft-DTW in place of TCC, from the latent": {"loss.consistency": "soft_dtw"} | _GRAPH,
    "soft-DTW beside TCC": {"loss.consistency": "both"},
    "TCC with variance": {"loss.consistency": "tcc_variance"},
    "TCC with Huber's error": {"loss.consistency": "tcc_huber"},
    "TCC as classification": {"loss.consistency": "tcc_classification"},
    "TCC with stochastic matching": {"loss.consistency": "tcc_stochastic"},
    "TCC with cosine similarity": {"loss.consistency": "tcc_cosine", "loss.temperature": 0.1},
    "no message passing": {"encoder.rounds": 0},
    "1 round of messages": {"encoder.rounds": 1},
    "4 rounds of messages": {"encoder.rounds": 4},
    "robot pooled": {"encoder.robot": True},
    "GraphIRL's interaction network": {"encoder.kind": "interaction"},
    "GraphIRL's MLP": {"encoder.kind": "mlp"} | _GRAPH,
    "scenes not turned": {"pretrain.turn_scenes": False},
    "no untouched object counts as moved": {"pretrain.random_activity": 0.0},
}
