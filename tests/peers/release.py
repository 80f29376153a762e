"""Installs what `tools/release` has built, each into an empty place, and runs the main job and the command lines of README.md from it.

    tools/release FOLDER && python3 tests/peers/release.py FOLDER

The tarball is unpacked into an empty root folder, the Debian package with its files alone into another one. With the libraries that the
binary names and nothing else of this machine, `modulo launch recovered.launch.yaml` and each line of the `sh` blocks of README.md
must end well in each, in a folder that has neither launch files nor sensors. A command that has not ended after LIMIT seconds gets Ctrl-C,
and `modulo param` has a running suite beside it.
Lines with placeholders in capitals, live cameras, ROS 2, other programs, or models and videos that are not there are skipped, and printed
with the reason. The wheel is installed into an empty environment, must unwrap an array, and its program must run the same lines. Prints the
seconds of each, from nothing to the first box or the first array. Needs root; without it the roots are not entered, and their checks are skipped.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FRAMES = 20
LIMIT = 30
README = Path(__file__).resolve().parents[2] / "README.md"
ENVIRONMENT = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/home", "ROS_DOMAIN_ID": "97"}
ARRAY = """
import numpy as np, modulo_camera as modulo
sensor = modulo.Sensor(bits=8, alpha=4, psf_sigma=1.4)
exposure = sensor.expose(np.tile(np.linspace(0, 1, 640, dtype=np.float32), (480, 1)))
assert (sensor.unwrap(exposure.modulo).counts == exposure.counts).all()
"""


def run(*command, **options):
    """Runs a command that must succeed; returns what it prints."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{command} ended with {done.returncode}: {done.stdout}{done.stderr}"
    return done.stdout


def only(folder, ending):
    """Returns the single file in a folder with this ending."""
    (found,) = folder.glob(f"*{ending}")
    return found


def add_libraries(root, binary):
    """Copies the shared libraries that `binary` names, and its loader, into `root`."""
    for line in run("ldd", binary).splitlines():
        for word in line.split():
            if word.startswith("/"):
                place = root / word[1:]
                place.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(word, place)


def begin(command, **options):
    """Starts a command whose outputs are read."""
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)


def start(root, *command):
    """Starts a command in the root folder `root`."""
    for folder in ("tmp", "dev", "proc", "home"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    script = 'mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev" && exec chroot "$0" "$@"'
    return begin(["unshare", "--mount", "sh", "-c", script, str(root), *command], env=ENVIRONMENT)


def commands():
    """Returns the words of each command in the `sh` blocks of README.md, without comments."""
    for block in re.findall(r"```sh\n(.*?)```", README.read_text(), re.S):
        for line in block.replace("\\\n", " ").splitlines():
            for command in re.split(r"\s&&\s", line):
                if words := shlex.split(command, comments=True):
                    # What the source runs by cargo is the program of the release.
                    yield ["modulo", *words[words.index("--") + 1 :]] if words[:2] == ["cargo", "run"] else words


def why_skipped(words, root):
    """Returns why a command of README.md cannot run in `root`; None for one that must run."""
    line = shlex.join(words)
    if found := re.search(r"(?<![\w$])[A-Z]{4,}(?![\w=])", line):
        return f"{found[0]} is a placeholder"
    if "rtsp://" in line or words[0] == "ros2":
        return "needs a camera or ROS 2"
    if words[0] != "modulo" and not words[0].endswith("bin/modulo"):
        return f"{words[0]} is no program of the release"
    files = [word.split(":=")[-1] for word in words if word.endswith((".onnx", ".mp4")) or word.startswith("source:=")]
    return next((f"there is no {file}" for file in files if "://" not in file and not (root / file).exists()), None)


def result(program, limit):
    """Returns the exit code of a started program and what it prints; after `limit` seconds it gets Ctrl-C."""
    with program:
        try:
            text, _ = program.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            program.send_signal(signal.SIGINT)
            text, _ = program.communicate(timeout=LIMIT)
    return program.returncode, text


def readme(root, modulo):
    """Runs each command of README.md with files in `root` by the program that `modulo` starts."""
    for words in commands():
        line, why = shlex.join(words), why_skipped(words, root)
        if why is None:
            suite = modulo("launch", "recovered", "rate:=2", "loop:=true") if words[1] == "param" else None
            code, text = result(modulo(*words[1:]), LIMIT)
            if suite is not None:
                result(suite, 0)
            why = "there is no network" if code == 1 and "cannot reach http" in text else None
            assert code == 0 or why, f"{line} ended with {code}: {text}"
        print(f"skipped: {line} ({why})" if why else f"ok: {line}", flush=True)


def main_job(root, binary, launch):
    """Runs the main job in `root`, and then README.md; returns the seconds until the first boxes."""
    job = [binary, "launch", launch, f"source:=scene://tunnel?seed=3&frames={FRAMES}", "--verbose"]
    began, first, lines = time.monotonic(), None, []
    with start(root, *job) as suite:
        for line in suite.stdout:
            lines.append(line)
            if first is None and " boxes: " in line:
                first = time.monotonic() - began
    assert suite.returncode == 0, "".join(lines)
    assert any(line.startswith(f"frames {FRAMES},") for line in lines), "".join(lines)
    # A download needs the names of the network.
    (root / "etc").mkdir(exist_ok=True)
    for name in ("resolv.conf", "hosts"):
        shutil.copy(f"/etc/{name}", root / "etc")
    readme(root, lambda *words: start(root, binary, *words))
    return first


def tarball(folder, root):
    """Unpacks the tarball in the root folder `root`; returns the seconds until the first box."""
    began = time.monotonic()
    run("tar", "-xzf", only(folder, "-gnu.tar.gz"), "-C", root)
    (top,) = root.iterdir()
    unpacked = time.monotonic() - began
    add_libraries(root, top / "lib/modulo/modulo")
    return unpacked + main_job(root, f"/{top.name}/bin/modulo", "recovered.launch.yaml")


def package(folder, root):
    """Installs the Debian package in `root`; returns the seconds until the first box."""
    began = time.monotonic()
    (root / "var/lib/dpkg/updates").mkdir(parents=True)
    (root / "var/lib/dpkg/info").mkdir()
    (root / "var/lib/dpkg/status").touch()
    # The packages that it depends on are not in this root, but their libraries are.
    run("dpkg", f"--root={root}", "--force-depends", "-i", only(folder, ".deb"))
    installed = time.monotonic() - began
    assert run("dpkg-deb", "-f", only(folder, ".deb"), "Depends").startswith("libc6"), "the dependencies are found"
    add_libraries(root, root / "usr/lib/modulo/modulo")
    return installed + main_job(root, "/usr/bin/modulo", "recovered.launch.yaml")


def wheel(folder, root):
    """Installs the wheel in an environment at `root`; returns the seconds until the first array, those of pip included."""
    found = only(folder, ".whl")
    assert "-abi3-manylinux" in found.name, found.name
    run(sys.executable, "-m", "venv", root)
    began = time.monotonic()
    run(root / "bin/pip", "install", "--quiet", found, cwd=root)
    run(root / "bin/python", "-c", ARRAY, cwd=root)
    seconds = time.monotonic() - began
    environment = {**ENVIRONMENT, "PATH": f"{root}/bin:{ENVIRONMENT['PATH']}", "HOME": str(root)}
    readme(root, lambda *words: begin(["modulo", *words], cwd=root, env=environment))
    return seconds


def main():
    """Checks the sums, and installs each form."""
    folder = Path(sys.argv[1]).resolve()
    run("sha256sum", "--check", "SHA256SUMS", cwd=folder)
    forms = {"tarball": tarball, "Debian package": package} if os.geteuid() == 0 else {}
    if list(folder.glob("*.whl")):
        forms["wheel"] = wheel
    if not os.geteuid() == 0:
        print("skipped: the tarball and the Debian package, whose roots only root can enter")
    for name, install in forms.items():
        with tempfile.TemporaryDirectory() as root:
            print(f"ok: {name}, {install(folder, Path(root)):.1f} s to the first result")


if __name__ == "__main__":
    main()
