"""Records a hand that pushes the puck, writes boxes beside the videos, and makes a set of them.

python make_films.py            40 videos in `films`, the demonstration set in `mine`
"""

import sys
from pathlib import Path

import cv2
import jax
import numpy as np
from my_task import MAT, PushPuck

from gril_jax.demos import import_videos

PIXELS, COLOURS = 128, {"mat": (90, 160, 60), "hand": (60, 60, 60), "puck": (40, 90, 220)}


def push(hand, puck, rng):
    """Walks around the puck until it is between hand and mat, then pushes."""
    way = np.asarray(MAT) - puck
    way /= np.linalg.norm(way) + 1e-9
    side = np.array([-way[1], way[0]])
    behind = (hand - puck) @ way
    aim = puck - 0.24 * way
    if behind > -0.12:  # not yet on the far side: keep off the puck
        aim = aim + 0.3 * side * np.sign((hand - puck) @ side + 1e-9)
    elif abs((hand - puck) @ side) < 0.05:
        aim = puck
    move = (aim - hand) / 0.08
    return np.clip(move / max(1.0, np.abs(move).max()) + rng.normal(0, 0.1, 2), -1, 1)


def film(path, seed):
    """One video and its CSV of boxes, until a little after the puck has come to the mat."""
    task, rng = PushPuck(), np.random.default_rng(seed)
    state, step = task.reset(jax.random.key(seed)), jax.jit(task.step)
    video = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 10, (PIXELS, PIXELS))
    rows, on_mat = ["frame,class,x_min,y_min,x_max,y_max"], 0
    for frame in range(80):
        picture = np.full((PIXELS, PIXELS, 3), 235, np.uint8)
        centers, sizes = np.asarray(state.objects.center), np.asarray(state.objects.size)
        for name, center, size in zip(task.classes, centers, sizes, strict=True):
            middle = (center * [1, -1] + 1) * PIXELS / 2
            low, high = middle - size * PIXELS / 4, middle + size * PIXELS / 4
            cv2.rectangle(picture, *np.round([low, high]).astype(int).tolist(), COLOURS[name], -1)
            rows.append(f"{frame},{name}," + ",".join(f"{x:.2f}" for x in (*low, *high)))
        video.write(picture)
        on_mat += int(state.metrics["success"])
        if on_mat > 3:
            break
        hand, puck = (np.asarray(x) for x in state.data)
        state = step(state, push(hand, puck, rng).astype(np.float32))
    video.release()
    path.with_suffix(".csv").write_text("\n".join(rows) + "\n")
    return on_mat > 3


def main(count=40):
    Path("films").mkdir(exist_ok=True)
    done = [film(Path(f"films/{seed:02d}.mp4"), seed) for seed in range(count)]
    of = {"task": "my_task", "classes": PushPuck.classes, "robot": ["hand"]}
    import_videos("films", "mine", half_extent=1.0, **of)
    print(f"{sum(done)} of {count} videos end on the mat")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
