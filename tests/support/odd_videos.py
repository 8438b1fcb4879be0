"""Videos as cameras and tools leave them: cut, mirrored, with wrong time stamps or covers.

Frame `t` of every one has the shade 40 + 4 t, so that a reader can tell which it has.
"""

from fractions import Fraction

import av
import numpy as np

W, H = 64, 48
MILLI = Fraction(1, 1000)


def shade(number):
    """The picture of a frame."""
    return np.full((H, W, 3), 40 + 4 * number, np.uint8)


def encoded(path, codec="libx264", frames=20, *, pictures=shade, options=None, prepare=None):
    """Writes a video, ten frames a second, and returns its path; the name tells the container."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=10, options=options or {})
        stream.width, stream.height = W, H
        stream.pix_fmt = "rgb8" if codec == "gif" else "yuv420p"
        if prepare is not None:
            prepare(stream)
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(pictures(number), format="rgb24")
            out.mux(stream.encode(frame.reformat(format=stream.pix_fmt)))
        out.mux(stream.encode())
    return path


def remuxed(path, source, change):
    """Copies packets into another file; `change` gets the list of (pts, dts, key, bytes), in
    milliseconds, and returns the one that is written."""
    with av.open(str(source)) as given, av.open(str(path), "w") as out:
        stream = given.streams.video[0]
        to = out.add_stream_from_template(stream)
        to.time_base = MILLI
        known = [
            (round(p.pts * stream.time_base * 1000),
             round((p.dts if p.dts is not None else p.pts) * stream.time_base * 1000),
             p.is_keyframe, bytes(p))
            for p in given.demux(stream) if p.size
        ]  # fmt: skip
        for pts, dts, key, data in change(known):
            packet = av.Packet(data)
            packet.stream, packet.time_base = to, MILLI
            packet.pts, packet.dts, packet.is_keyframe = pts, dts, key
            out.mux(packet)
    return path


def cut_at_open_group(path, codec="libx265"):
    """A video that was cut without encoding at a picture which later ones are shown before."""
    keys = "keyint=12:min-keyint=12:scenecut=0:bframes=2:b-adapt=0"
    options = {"x265-params": f"{keys}:open-gop=1:log-level=none"}
    if codec == "libx264":
        options = {"x264-params": f"{keys}:open-gop=1"}
    whole = encoded(path.with_name("whole.mkv"), codec, 30, options=options)

    def later(known):
        second = [at for at, one in enumerate(known) if one[2]][1]
        rest = known[second:]
        shown = sorted(pts for pts, *_ in rest)
        return [
            (pts - shown[0], dts - shown[0] - 300, *one)
            for dts, (pts, _, *one) in zip(shown, rest, strict=True)
        ]

    remuxed(path, whole, later)
    whole.unlink()
    return path
