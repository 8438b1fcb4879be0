"""Temporal cycle-consistency as the papers write it: plain loops over frames, in float64."""

import numpy as np


def similarity(a, b, kind, temperature, unit):
    """Scaled similarity of two latents; squared distances are divided by D unless `unit`."""
    if kind == "cosine":
        return float(a @ b) / temperature
    return -float(((a - b) ** 2).sum()) / (1 if unit else len(a)) / temperature


def softmax(x):
    e = np.exp(np.asarray(x) - np.max(x))
    return e / e.sum()


def lengthened(latents, unit):
    latents = np.asarray(latents, np.float64)
    return latents / np.linalg.norm(latents, axis=-1, keepdims=True) if unit else latents


def path(start, videos, kind="l2", temperature=1.0, unit=False):
    """Logits over the frames of the last video, after a soft neighbour in each before it."""
    position = start
    for video in videos[:-1]:
        weights = softmax([similarity(position, frame, kind, temperature, unit) for frame in video])
        position = sum(w * frame for w, frame in zip(weights, video, strict=True))
    return np.array([similarity(position, f, kind, temperature, unit) for f in videos[-1]])


def error(logits, times, home, form="regression_mse", delta=0.1, weight=0.001, smoothing=0.1):
    """The value of one query, by the published formula of each form."""
    beta = softmax(logits)
    num = len(logits)
    if form == "classification":
        logs = logits - np.max(logits) - np.log(np.exp(logits - np.max(logits)).sum())
        targets = [smoothing / (num - 1)] * num
        targets[home] += 1 - smoothing
        return -sum(t * x for t, x in zip(targets, logs, strict=True))
    mean = sum(b * t for b, t in zip(beta, times, strict=True))
    off = mean - times[home]
    if form == "regression_mse":
        return off**2
    if form == "regression_huber":
        return 0.5 * off**2 if abs(off) <= delta else delta * abs(off) - 0.5 * delta**2
    log_variance = np.log(sum(b * (t - mean) ** 2 for b, t in zip(beta, times, strict=True)))
    return np.exp(-log_variance) * off**2 + weight * log_variance


def pair(query, other, times, form="regression_mse", kind="l2", temperature=1.0, unit=False):
    """Each query frame's value after a cycle through the other video."""
    query, other = lengthened(query, unit), lengthened(other, unit)
    times = np.asarray(times, np.float64)
    cycles = (path(frame, [other, query], kind, temperature, unit) for frame in query)
    return np.array([error(logits, times, t, form) for t, logits in enumerate(cycles)])


def video(seed, num_frames, width=6):
    return np.random.default_rng(seed).normal(size=(num_frames, width)).astype(np.float32)
