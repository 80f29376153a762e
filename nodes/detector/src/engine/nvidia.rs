//! Finds the GPUs of NVIDIA with their driver, and the libraries of CUDA, cuDNN and TensorRT that packages of pip bring. These are loaded before ONNX
//! Runtime asks for them, so that no variable has to name their folders.

use std::fs;
use std::path::{Path, PathBuf};

/// Where the driver tells of itself.
const DRIVER: &str = "/proc/driver/nvidia";

/// The libraries that the providers of ONNX Runtime name. Each loads its further parts itself, from its own folder.
const NAMES: [&str; 9] = [
    "libcudart.so.",
    "libcublasLt.so.",
    "libcublas.so.",
    "libnvrtc.so.",
    "libcurand.so.",
    "libcufft.so.",
    "libcudnn.so.",
    "libnvinfer.so.",
    "libnvonnxparser.so.",
];

/// Returns the GPUs of NVIDIA of this machine, each with the version of its driver.
pub fn gpus() -> Vec<String> {
    gpus_of(Path::new(DRIVER))
}

fn gpus_of(driver: &Path) -> Vec<String> {
    let version = fs::read_to_string(driver.join("version")).unwrap_or_default();
    // "NVRM version: NVIDIA UNIX x86_64 Kernel Module  580.65.06  Sun Jul 27 ...": the first number with points.
    let is_version =
        |word: &&str| word.contains('.') && word.split('.').all(|part| part.parse::<u32>().is_ok());
    let version = version.split_whitespace().find(is_version).unwrap_or("of unknown version").to_owned();
    let model = |gpu: PathBuf| {
        let information = fs::read_to_string(gpu.join("information")).ok()?;
        let model = information.lines().find_map(|line| line.strip_prefix("Model:"))?;
        Some(format!("{}, driver {version}", model.trim()))
    };
    inside(&driver.join("gpus")).into_iter().filter_map(model).collect()
}

/// Returns the libraries of CUDA, cuDNN and TensorRT that are found for the ONNX Runtime at `library`.
pub fn libraries(library: &Path) -> Vec<PathBuf> {
    found(library, std::env::var_os("VIRTUAL_ENV").map(PathBuf::from).as_deref())
}

/// Returns the libraries in the order of their names: those beside the package that has `library` as `onnxruntime/capi/FILE`, or
/// else those in the environment at `active`.
fn found(library: &Path, active: Option<&Path>) -> Vec<PathBuf> {
    let own = library.ancestors().nth(3).map(Path::to_owned);
    let pythons = active.into_iter().flat_map(|folder| inside(&folder.join("lib")));
    let packages = own.into_iter().chain(pythons.map(|python| python.join("site-packages")));
    let in_package = |package: PathBuf| {
        let folders = inside(&package.join("nvidia")).into_iter().map(|part| part.join("lib"));
        let folders = folders.chain([package.join("tensorrt_libs")]);
        folders.flat_map(|folder| inside(&folder)).collect::<Vec<_>>()
    };
    let files = packages.map(in_package).find(|files| !files.is_empty()).unwrap_or_default();
    let named = |name: &&str| {
        let is_named =
            |file: &&PathBuf| file.file_name().is_some_and(|own| own.to_string_lossy().starts_with(*name));
        files.iter().find(is_named).cloned()
    };
    NAMES.iter().filter_map(named).collect()
}

/// The beginning of the name of a missing library, and the sentence that says how to get it. The first one that fits counts, and the empty
/// one fits all.
const REMEDIES: [(&str, &str); 4] = [
    ("libcuda.so", "install the driver of the GPU"),
    (
        "libnv",
        "install this version of TensorRT, such as by pip install 'tensorrt-cu13-libs<11' into the active environment",
    ),
    (
        "libcu",
        "install CUDA and cuDNN, such as by pip install 'onnxruntime-gpu[cuda,cudnn]' into the active environment",
    ),
    ("", "fetch one that can (modulo model runtime --build openvino or gpu)"),
];

/// Returns the end of ONNX Runtime's words of a provider that cannot be loaded, which names the library that is missing; all of others.
pub fn missing(why: &str) -> &str {
    why.rsplit_once("with error: ").map_or(why, |(_, missing)| missing)
}

/// Returns what to do where a provider cannot be used.
pub fn remedy(why: &str) -> &'static str {
    let fits = |(name, _): &&(&str, &str)| missing(why).starts_with(name);
    REMEDIES.iter().find(fits).expect("each text begins with the empty one").1
}

/// Returns what lies in `folder`, sorted; nothing where there is no such folder.
fn inside(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libraries_are_found_beside_the_package_and_else_in_the_active_environment() {
        let folder = tempfile::tempdir().expect("a folder");
        let put = |file: &str| {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            fs::write(&path, []).expect("written");
            path
        };
        let library = put("venv/lib/python3.11/site-packages/onnxruntime/capi/libonnxruntime.so.1.31.1");
        let active = folder.path().join("venv");
        let elsewhere = Path::new("/opt/modulo/lib/modulo/libonnxruntime.so");
        assert_eq!(found(&library, Some(&active)), [""; 0].map(PathBuf::from));
        let site = "venv/lib/python3.11/site-packages";
        let cudnn = put(&format!("{site}/nvidia/cudnn/lib/libcudnn.so.9"));
        put(&format!("{site}/nvidia/cudnn/lib/libcudnn_ops.so.9"));
        let cuda = put(&format!("{site}/nvidia/cu13/lib/libcudart.so.13"));
        let parser = put(&format!("{site}/tensorrt_libs/libnvonnxparser.so.10"));
        let all = [cuda, cudnn, parser];
        assert_eq!(found(&library, None), all);
        assert_eq!(found(elsewhere, Some(&active)), all);
        assert_eq!(found(elsewhere, None), [""; 0].map(PathBuf::from));
    }

    #[test]
    fn a_missing_library_is_named_with_what_brings_it() {
        let told = |library: &str| {
            let why = format!(
                "/src/bridge.cc:2043 Get() FAIL : Failed to load library /x/lib_cuda.so with error: {library}: no such file"
            );
            assert_eq!(missing(&why), format!("{library}: no such file"));
            remedy(&why)
        };
        assert!(told("libcuda.so.1").contains("driver"));
        assert!(
            told("libcudnn.so.9").contains("[cuda,cudnn]")
                && told("libcublasLt.so.13").contains("[cuda,cudnn]")
        );
        assert!(told("libnvinfer.so.10").contains("tensorrt-cu13-libs<11"));
        assert!(remedy("it was built without CUDAExecutionProvider").contains("--build openvino or gpu"));
    }

    #[test]
    fn gpus_are_read_from_what_the_driver_tells() {
        let folder = tempfile::tempdir().expect("a folder");
        assert_eq!(gpus_of(&folder.path().join("none")), [""; 0]);
        let gpu = folder.path().join("gpus/0000:18:00.0");
        fs::create_dir_all(&gpu).expect("made");
        fs::write(gpu.join("information"), "Model: \t\t NVIDIA H200\nIRQ:   \t\t 45\n").expect("written");
        let version = "NVRM version: NVIDIA UNIX x86_64 Kernel Module  580.65.06  Sun Jul 27 07:15:22 UTC 2025\nGCC version:  gcc version 12.3.0";
        fs::write(folder.path().join("version"), version).expect("written");
        assert_eq!(gpus_of(folder.path()), ["NVIDIA H200, driver 580.65.06"]);
    }
}
