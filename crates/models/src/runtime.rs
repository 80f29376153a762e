//! ONNX Runtime, which the faster inference engine needs: its released wheels, and the libraries in them.

use std::fmt::Display;
use std::fs::Permissions;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use flate2::read::DeflateDecoder;

use crate::FetchError;

/// The wheels: what the library computes on, the processor, the sha256 and the URL of each.
const WHEELS: &str = include_str!("../onnxruntime.txt");

/// Parts of the wheels that serve Python, C or other devices, and second copies.
const UNUSED: [&str; 7] =
    ["pybind11", "_gpu_plugin", "_npu_plugin", "_hetero_plugin", "_auto_plugin", "openvino_c.so", ".so.2025"];

/// A released wheel of ONNX Runtime for Linux with glibc 2.28. Its libraries do not depend on the version of Python.
#[derive(Clone, Copy, Debug)]
pub struct Wheel {
    build: &'static str,
    arch: &'static str,
    /// The sha256 as 64 hexadecimal digits.
    pub sha256: &'static str,
    /// The URL of the file.
    pub url: &'static str,
}

impl Wheel {
    fn all() -> impl Iterator<Item = Self> {
        WHEELS.lines().filter_map(|line| {
            let mut words = line.split(' ');
            let mut word = || words.next();
            Some(Self { build: word()?, arch: word()?, sha256: word()?, url: word()? })
        })
    }

    /// Finds the wheel of a build, `cpu`, `openvino` or `gpu`, for a processor, such as `x86_64`.
    ///
    /// # Errors
    /// [`FetchError`] with the processors for which this build is released.
    pub fn find(build: &str, arch: &str) -> Result<Self, FetchError> {
        Self::all().find(|wheel| wheel.build == build && wheel.arch == arch).ok_or_else(|| {
            let released: Vec<_> =
                Self::all().filter(|wheel| wheel.build == build).map(|wheel| wheel.arch).collect();
            let why =
                format!("there is no ONNX Runtime '{build}' for {arch}, only for {}", released.join(" and "));
            FetchError(format!("{why}; build it from its source, and set ORT_DYLIB_PATH to its library"))
        })
    }

    /// The name of the file.
    pub fn file_name(&self) -> &'static str {
        self.url.rsplit('/').next().unwrap_or(self.url)
    }

    /// Takes the libraries out of the file `wheel`, whose sha256 was verified, into `folder`; each one that is there is replaced in one step.
    /// Returns the path of the library of ONNX Runtime.
    ///
    /// # Errors
    /// [`FetchError`] when the file is no such wheel, or a library cannot be written.
    pub fn unpack(&self, wheel: &Path, folder: &Path) -> Result<PathBuf, FetchError> {
        let failed = |path: &Path, why: &dyn Display| FetchError(format!("{}: {why}", path.display()));
        let archive = std::fs::read(wheel).map_err(|why| failed(wheel, &why))?;
        let members = members(&archive).ok_or_else(|| failed(wheel, &"is no wheel that can be read"))?;
        let version = format!(".{}", self.file_name().split('-').nth(1).unwrap_or_default());
        let is_used = |name: &str| {
            name.starts_with("onnxruntime/capi/lib") && !UNUSED.iter().any(|part| name.contains(part))
        };
        for (name, data) in members.into_iter().filter(|(name, _)| is_used(name)) {
            let library = name.rsplit('/').next().unwrap_or(name);
            let target = folder.join(library.strip_suffix(&version).unwrap_or(library));
            write(&target, folder, data).map_err(|why| failed(&target, &why))?;
        }
        let library = folder.join("libonnxruntime.so");
        if library.is_file() { Ok(library) } else { Err(failed(wheel, &"has no library of ONNX Runtime")) }
    }
}

/// Writes a compressed member of an archive to `target` in one step. Another file is never replaced.
fn write(target: &Path, folder: &Path, data: &[u8]) -> io::Result<()> {
    let mode = Permissions::from_mode(0o755);
    let mut unfinished = tempfile::Builder::new().permissions(mode).tempfile_in(folder)?;
    io::copy(&mut DeflateDecoder::new(data), &mut unfinished)?;
    let Err(why) = unfinished.persist_noclobber(target) else { return Ok(()) };
    match std::fs::read(target) {
        Ok(there) if there == std::fs::read(why.file.path())? => Ok(()),
        Ok(_) => Err(io::Error::other(
            "is already there, but not of this version; move it away or choose another folder",
        )),
        Err(_) => Err(why.error),
    }
}

/// Returns the names and the compressed bytes of the members that the directory at the end of a zip archive lists; `None` for anything else
/// than such an archive.
fn members(archive: &[u8]) -> Option<Vec<(&str, &[u8])>> {
    let bytes = |at: usize, count: usize| archive.get(at..at.checked_add(count)?);
    let u16 = |at| Some(usize::from(u16::from_le_bytes(bytes(at, 2)?.try_into().ok()?)));
    let u32 = |at| usize::try_from(u32::from_le_bytes(bytes(at, 4)?.try_into().ok()?)).ok();
    let end = archive.windows(4).rposition(|four| four == b"PK\x05\x06")?;
    let (count, mut at) = (u16(end + 10)?, u32(end + 16)?);
    let mut members = Vec::new();
    for _ in 0..count {
        let (length, local) = (u16(at + 28)?, u32(at + 42)?);
        let data = local + 30 + u16(local + 26)? + u16(local + 28)?;
        members.push((std::str::from_utf8(bytes(at + 46, length)?).ok()?, bytes(data, u32(at + 20)?)?));
        at += 46 + length + u16(at + 30)? + u16(at + 32)?;
    }
    Some(members)
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use flate2::{Compression, write::DeflateEncoder};
    use proptest::prelude::*;

    use super::*;

    /// A zip archive of these files.
    fn zip(files: &[(&str, &[u8])]) -> Vec<u8> {
        let (mut archive, mut directory) = (Vec::new(), Vec::new());
        for (name, content) in files {
            let mut deflate = DeflateEncoder::new(Vec::new(), Compression::default());
            deflate.write_all(content).expect("into memory");
            let data = deflate.finish().expect("into memory");
            let sizes = [data.len(), content.len()].map(|size| (size as u32).to_le_bytes()).concat();
            // Version, flags and method, time, date and checksum, the sizes, and the lengths of the name and of an extra field.
            let fields =
                [&[20, 0, 0, 0, 8, 0][..], &[0; 8], &sizes, &(name.len() as u16).to_le_bytes(), &[3, 0]]
                    .concat();
            directory.extend(
                [&b"PK\x01\x02\x14\x00"[..], &fields, &[0; 10], &(archive.len() as u32).to_le_bytes()]
                    .concat(),
            );
            directory.extend([name.as_bytes(), &[0; 3]].concat());
            archive.extend([&b"PK\x03\x04"[..], &fields, name.as_bytes(), &[0; 3], &data].concat());
        }
        let (start, count) = (archive.len() as u32, files.len() as u16);
        archive.extend(directory);
        archive.extend(
            [
                &b"PK\x05\x06\x00\x00\x00\x00"[..],
                &count.to_le_bytes(),
                &count.to_le_bytes(),
                &[0; 4],
                &start.to_le_bytes(),
                &[0; 2],
            ]
            .concat(),
        );
        archive
    }

    fn unpacked(archive: &[u8]) -> (tempfile::TempDir, Result<PathBuf, FetchError>) {
        let folder = tempfile::tempdir().expect("a folder");
        let wheel = folder.path().join("a.whl");
        std::fs::write(&wheel, archive).expect("writable");
        let library = Wheel::find("cpu", "x86_64").expect("released").unpack(&wheel, folder.path());
        (folder, library)
    }

    #[test]
    fn only_the_libraries_leave_the_wheel() {
        let library = b"library".repeat(1000);
        let (folder, found) = unpacked(&zip(&[
            ("onnxruntime/__init__.py", b"python"),
            ("onnxruntime/capi/libonnxruntime.so.1.31.1", &library),
            ("onnxruntime/capi/libonnxruntime_providers_shared.so", b"shared"),
            ("onnxruntime/capi/lib_gpu_plugin.so", b"unused"),
        ]));
        assert_eq!(std::fs::read(found.expect("unpacked")).expect("a file"), library);
        let mut names: Vec<_> =
            folder.path().read_dir().expect("a folder").flatten().map(|entry| entry.file_name()).collect();
        names.sort();
        assert_eq!(names, ["a.whl", "libonnxruntime.so", "libonnxruntime_providers_shared.so"]);
    }

    #[test]
    fn a_wheel_that_cannot_be_used_says_why() {
        let whole = zip(&[("onnxruntime/capi/libonnxruntime.so.1.31.1", &[7; 500])]);
        let mut damaged = whole.clone();
        // The first byte behind the local header, the name and the extra field.
        damaged[30 + 42 + 3] = 0xff;
        for (archive, why) in [
            (&whole[..whole.len() - 30], "no wheel that can be read"),
            (&zip(&[("other", b"")])[..], "has no library of ONNX Runtime"),
            (&damaged, "libonnxruntime.so: corrupt deflate stream"),
        ] {
            let found = unpacked(archive).1.expect_err("refused").to_string();
            assert!(found.contains(why), "{found}");
        }
    }

    #[test]
    fn each_wheel_has_an_address_a_version_and_a_hash() {
        assert_eq!(Wheel::all().count(), WHEELS.lines().count());
        for wheel in Wheel::all() {
            assert!(wheel.sha256.len() == 64 && wheel.file_name().starts_with("onnxruntime"), "{wheel:?}");
            assert!(wheel.url.starts_with("https://") && wheel.file_name().contains(wheel.arch), "{wheel:?}");
        }
        let why = Wheel::find("openvino", "aarch64").expect_err("not released").to_string();
        assert!(why.contains("'openvino'") && why.contains("aarch64, only for x86_64;"), "{why}");
    }

    proptest! {
        #[test]
        fn damaged_archives_are_no_panic(at in 0..200_usize, byte: u8, end in 0..400_usize) {
            let mut archive = zip(&[("onnxruntime/capi/libonnxruntime.so", b"abc"), ("b.txt", b"text")]);
            let length = archive.len();
            archive[at % length] = byte;
            archive.truncate(end);
            drop(unpacked(&archive));
        }
    }
}
