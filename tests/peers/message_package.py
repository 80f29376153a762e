"""Makes a package of messages for the ROS 2 of PyPI, whose wheels hold generators but no `vision_msgs`: C code and its type supports.

    PYTHON_OF_ROS tests/peers/message_package.py PACKAGE FOLDER_OF_MSG PREFIX_OF_ROS OUT

FOLDER_OF_MSG holds the definitions, PREFIX_OF_ROS is the environment of the wheels. OUT becomes a prefix for AMENT_PREFIX_PATH, with the
definitions, headers and libraries. It needs gcc and g++.
"""

import subprocess
import sys
from pathlib import Path

from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

# Type supports: the compiler, the files, and the libraries of which each package has one.
LIBRARIES = {
    "generator_c": ("gcc", ["detail/*__functions.c", "detail/*__description.c"], ["rosidl_runtime_c", "rcutils"]),
    "typesupport_introspection_c": ("gcc", ["detail/*__type_support.c"], ["rosidl_typesupport_introspection_c"]),
    "typesupport_fastrtps_c": ("g++", ["detail/*__type_support_c.cpp"],
                               ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_fastrtps_cpp", "fastcdr"]),
    "typesupport_c": ("g++", ["*__type_support.cpp"], ["rosidl_typesupport_c"]),
}
NEEDED = ["std_msgs", "geometry_msgs"]


def main(package, source, prefix, out):
    share, headers = out / "share" / package, out / "include" / package
    (share / "msg").mkdir(parents=True)
    names = sorted(file.stem for file in (source / "msg").glob("*.msg"))
    for name in names:
        convert_msg_to_idl(source, package, Path(f"msg/{name}.msg"), share / "msg")
        (share / f"msg/{name}.msg").write_bytes((source / f"msg/{name}.msg").read_bytes())
    index = out / "share/ament_index/resource_index"
    for kind, text in [("packages", ""), ("rosidl_interfaces", "".join(f"msg/{name}.msg\nmsg/{name}.idl\n" for name in names))]:
        (index / kind).mkdir(parents=True)
        (index / kind / package).write_text(text)
    files, paths = [f"{share}:msg/{name}.idl" for name in names], [str(prefix / "share"), str(share)]
    for generate in [GenerateC, GenerateCTypesupport, GenerateFastRTPSCTypesupport, GenerateIntrospectionCTypesupport]:
        generate(package).generate(package, files, paths, headers / package)
    (out / "lib").mkdir()
    includes = [f"-I{folder}" for folder in [headers, prefix / "include", *(prefix / "include").iterdir()]]
    folders = [f"-L{out / 'lib'}", f"-L{prefix / 'lib'}"]
    for kind, (compiler, patterns, libraries) in LIBRARIES.items():
        sources = [file for pattern in patterns for file in sorted((headers / package / "msg").glob(pattern))]
        others = [f"-l{needed}__rosidl_{kind}" for needed in NEEDED]
        own = [] if kind == "generator_c" else [f"-l{package}__rosidl_generator_c"]
        subprocess.run([compiler, "-shared", "-fPIC", "-w", *includes, "-o", out / f"lib/lib{package}__rosidl_{kind}.so", *sources,
                        *folders, *own, *others, *(f"-l{library}" for library in libraries)], check=True)


if __name__ == "__main__":
    main(sys.argv[1], *(Path(path).resolve() for path in sys.argv[2:5]))
