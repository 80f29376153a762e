#!/usr/bin/env python3
"""Put ONNX Runtime's library where `modulo` finds it.

    python tools/install_onnxruntime.py [--build cpu|openvino|gpu] [--folder FOLDER] [--arch x86_64|aarch64] [--wheel FILE]

cpu is ONNX Runtime for the processor; openvino adds OpenVINO's kernels (engine:=openvino), gpu CUDA and TensorRT
(device:=cuda, device:=tensorrt), whose own libraries must be there already. The pinned wheel comes from PyPI through
pip (or is FILE, copied here by hand), is checked by sha256, and only its libraries are taken out of it. Needs
Python 3.9 and pip, Linux with glibc 2.28. Nothing is installed into Python.
"""

import argparse
import hashlib
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

# The libraries do not depend on Python: one wheel for each build and architecture will do. From `pip hash WHEEL`.
PYTHON = "3.12"
BUILDS = {
    "cpu": ("onnxruntime", "1.31.1", {
        "x86_64": "1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536",
        "aarch64": "0b9a492176886992e0e875f06bc0367e333f5fff11711a2d642e18b02f3009cc",
    }),
    "openvino": ("onnxruntime-openvino", "1.24.1", {
        "x86_64": "d617fac2f59a6ab5ea59a788c3e1592240a129642519aaeaa774761dfe35150e",
    }),
    "gpu": ("onnxruntime-gpu", "1.31.1", {
        "x86_64": "05d548956197b9d01f59b625de740e0d6be3593f874e241a12dc0362650ecdf7",
        "aarch64": "a0f1725c5a6d1ef82d63498b5ebc25e2c90c9560e91dc76db9be4a49162d4d33",
    }),
}
# Parts of the wheels that serve Python, C or other devices, and second copies.
UNUSED = ("pybind11", "_gpu_plugin", "_npu_plugin", "_hetero_plugin", "_auto_plugin", "openvino_c.so", ".so.2025")
BESIDE_THE_BINARY = Path(__file__).resolve().parent.parent / "target" / "release"


def parse():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", choices=BUILDS, default="cpu", help="which ONNX Runtime (%(default)s)")
    parser.add_argument("--folder", type=Path, default=BESIDE_THE_BINARY, help="where the library goes (%(default)s)")
    parser.add_argument("--arch", default=platform.machine(), help="x86_64 or aarch64 (%(default)s)")
    parser.add_argument("--wheel", type=Path, help="a wheel that is here already, for machines without a network")
    return parser.parse_args()


def download(build, arch, folder):
    """The pinned wheel, in `folder`."""
    name, version, sha256 = BUILDS[build]
    pin = folder / "pin.txt"
    pin.write_text(f"{name}=={version} --hash=sha256:{sha256[arch]}\n")
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:"]
    command += ["--python-version", PYTHON]
    command += [option for glibc in ("27", "28", "34") for option in ("--platform", f"manylinux_2_{glibc}_{arch}")]
    command += ["--require-hashes", "--requirement", str(pin), "--dest", str(folder)]
    if subprocess.run(command, stdout=sys.stderr).returncode != 0:
        sys.exit(
            f"pip could not download {name} {version} for {arch} (its reason is above); without a network, copy "
            f"that wheel (cp{PYTHON.replace('.', '')}, manylinux, {arch}) here and give it with --wheel FILE"
        )
    return next(folder.glob("*.whl"))


def extract(wheel, build, arch, folder):
    """The libraries of `wheel`, checked, in `folder`. A library that is there is replaced as a whole."""
    name, version, sha256 = BUILDS[build]
    content = wheel.read_bytes()
    got = hashlib.sha256(content).hexdigest()
    if got != sha256[arch]:
        sys.exit(f"{wheel}: sha256 is {got}, expected is {sha256[arch]} ({name} {version}, {arch}); nothing is installed")
    folder.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(wheel) as archive:
        for member in archive.namelist():
            library = Path(member).name
            if not member.startswith("onnxruntime/capi/lib") or any(part in library for part in UNUSED):
                continue
            library = library.removesuffix(f".{version}")
            unfinished = folder / f"{library}.part"
            unfinished.write_bytes(archive.read(member))
            unfinished.chmod(0o755)
            os.replace(unfinished, folder / library)
    return (folder / "libonnxruntime.so").resolve()


def main():
    args = parse()
    arch = {"amd64": "x86_64", "arm64": "aarch64"}.get(args.arch.lower(), args.arch)
    name, _, wheels = BUILDS[args.build]
    if arch not in wheels:
        sys.exit(f"--arch {arch}: {name} has wheels for {' and '.join(wheels)} only")
    with tempfile.TemporaryDirectory() as scratch:
        wheel = args.wheel or download(args.build, arch, Path(scratch))
        library = extract(wheel, args.build, arch, args.folder)
    print(f"export ORT_DYLIB_PATH={library}")


if __name__ == "__main__":
    main()
