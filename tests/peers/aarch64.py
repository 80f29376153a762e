"""Runs the program for 64-bit ARM on an emulator, and compares what it makes with what the program for this machine makes.

    python3 tests/peers/aarch64.py MODULO MODULO_OF_ARM

Both take the same frames through the three nodes in lockstep: the codes of the sensor, the recovered images, what `unwrap` says of them and the
boxes of the embedded detector must be the same bytes. Then both launch the nodes in one process: frames, detected objects and losses must
be equal. Needs qemu-aarch64-static.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from mcap.reader import make_reader

TOPICS = ["/sensor_info", "/modulo", "/saturated", "/ideal", "/recovered", "/hdr", "/metered", "/recovery", "/confidence", "/detector/detections"]
SCENES = {
    "steady": ["source:=scene://tunnel?seed=3&width=640&height=192&frames=3"],
    "noisy": ["source:=scene://glare?seed=4&width=640&height=192&frames=3", "read_noise:=2.0", "shot_noise:=0.5", "alpha:=8.0"],
    "mosaic": ["source:=scene://day?seed=5&width=640&height=192&frames=3", "mosaic:=rggb", "deblur:=true"],
}


def run(*command, cwd):
    """Runs a command that must end with 0."""
    done = subprocess.run([str(word) for word in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{command} ended with {done.returncode}: {done.stdout}{done.stderr}"


def recorded(folder, program, arguments):
    """Returns the bytes of the messages of each topic."""
    folder.mkdir(parents=True)
    topics = ["--topics", *TOPICS]
    run(*program, "eval", "recovered.launch.yaml", *arguments, "--bag", "bag", *topics, "-o", "out", "--difficulty", "all", cwd=folder)
    found = {topic: [] for topic in TOPICS}
    for path in sorted(folder.rglob("*.mcap")):
        with path.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                # The state of the detector is in every bag.
                if channel.topic in found:
                    found[channel.topic].append(message.data)
    return found


def launched(folder, program):
    """Returns what a launch says of its frames."""
    summary = folder / "summary.json"
    # A process of its own under the emulator is not ready within the minute for which nodes wait for each other.
    run(*program, "launch", "--compose", "recovered", "frames:=6", "--summary", summary, cwd=folder)
    said = json.loads(summary.read_text())
    return {key: said[key] for key in ("frames", "detections", "dropped", "unwrapped")}


def main():
    """Compares frames in lockstep and launches."""
    here, there = [Path(sys.argv[1]).resolve()], ["qemu-aarch64-static", Path(sys.argv[2]).resolve()]
    with tempfile.TemporaryDirectory() as folder:
        for name, arguments in SCENES.items():
            ours, theirs = (recorded(Path(folder) / name / str(side), program, arguments) for side, program in enumerate((here, there)))
            for topic in TOPICS:
                assert ours[topic] and ours[topic] == theirs[topic], f"{name}: {topic} differs, or is empty"
            print(f"ok: {name}: {len(ours['/modulo'])} frames, all bytes equal", flush=True)
        ours, theirs = (launched(Path(folder), program) for program in (here, there))
        assert ours == theirs, f"{ours} is not {theirs}"
        print(f"ok: launched: {ours['frames']} frames, {json.dumps(ours['detections'])}, {ours['unwrapped']}")


if __name__ == "__main__":
    main()
