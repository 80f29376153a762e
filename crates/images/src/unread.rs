//! [`unread`]: what a file is that is no image of those that are read.

use std::path::Path;

use image::ImageFormat;

use crate::has_extension;

/// The remedy for the raw file of a camera.
pub(crate) const RAW_REMEDY: &str =
    "write its raw codes as TIFF, such as by: dcraw -D -4 -T FILE (or by LibRaw: unprocessed_raw -T FILE)";

/// File name extensions of the raw files of cameras, in lower case. Most of them are TIFF files whose first image is a preview.
pub const RAW_EXTENSIONS: [&str; 21] = [
    "dng", "nef", "nrw", "arw", "sr2", "srf", "cr2", "cr3", "crw", "raf", "rw2", "orf", "pef", "srw", "3fr",
    "iiq", "x3f", "rwl", "erf", "kdc", "dcr",
];

/// Files that are taken for images: what their first bytes are, at this place; without a name, raw files of cameras.
const OTHERS: [(usize, &[u8], Option<&str>); 25] = [
    (8, b"CR\x02", None),
    (4, b"ftypcrx ", None),
    (0, b"FUJIFILMCCD-RAW", None),
    (0, b"IIU\0", None),
    (0, b"IIRO", None),
    (0, b"IIRS", None),
    (0, b"MMOR", None),
    (0, b"FOVb", None),
    (4, b"ftypheic", Some("HEIC")),
    (4, b"ftypheix", Some("HEIC")),
    (4, b"ftypmif1", Some("HEIF")),
    (4, b"ftypmsf1", Some("HEIF")),
    (4, b"jP  \r\n", Some("JPEG 2000")),
    (0, b"\xff\x4f\xff\x51", Some("JPEG 2000")),
    (4, b"JXL \r\n", Some("JPEG XL")),
    (0, b"\xff\x0a", Some("JPEG XL")),
    (0, b"8BPS", Some("PSD")),
    (0, b"%PDF", Some("PDF")),
    (0, b"<svg", Some("SVG")),
    (0, b"Pf\n", Some("PFM")),
    (0, b"PF\n", Some("PFM")),
    (0, b"SIMPLE  =", Some("FITS")),
    (0, b"\x93NUMPY", Some("array of NumPy")),
    (0, b"\x89HDF", Some("HDF5")),
    (0, b"PK\x03\x04", Some("ZIP archive")),
];

/// Returns why the file at `path` with these first bytes is not read, and the remedy; `None` for an image that is read, or for an unknown file.
pub fn unread(path: &Path, bytes: &[u8]) -> Option<String> {
    if has_extension(path, &RAW_EXTENSIONS) {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        return Some(raw(&format!(" ({})", extension.to_uppercase())));
    }
    unread_content(bytes)
}

/// Returns why a file with these first bytes is not read, as [`unread`] does.
pub(crate) fn unread_content(bytes: &[u8]) -> Option<String> {
    let begins = |at: usize, with: &[u8]| bytes.get(at..).is_some_and(|rest| rest.starts_with(with));
    let name = match OTHERS.iter().find(|(at, first, _)| begins(*at, first)) {
        Some((.., None)) => return Some(raw("")),
        Some((.., name)) => name.map(str::to_owned),
        None => {
            let format = image::guess_format(bytes).ok().filter(|format| !is_read(*format))?;
            let kinds = if format == ImageFormat::Pnm { " (PBM, PGM or PPM)" } else { "" };
            Some(format!("{format:?}").to_uppercase() + kinds)
        }
    };
    name.map(|name| format!("{name} is not read; convert it to PNG"))
}

/// Returns the refusal of a raw file, of which `kind` tells more, such as ` (DNG)`.
pub(crate) fn raw(kind: &str) -> String {
    format!("is the raw file of a camera{kind}, which is not read; {RAW_REMEDY}")
}

/// Returns whether images of this format are read.
fn is_read(format: ImageFormat) -> bool {
    matches!(format, ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Hdr)
        || (cfg!(feature = "tiff") && format == ImageFormat::Tiff)
        || (cfg!(feature = "exr") && format == ImageFormat::OpenExr)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_read_is_named() {
        let read = |bytes: &[u8]| crate::decode(bytes, "a").expect_err("not read").to_string();
        for (bytes, name) in [
            (&b"GIF89a\x01\0\x01\0"[..], "GIF"),
            (b"P5\n2 2\n255\n\0\0\0\0", "PGM"),
            (b"BM\x1e\0\0\0\0\0\0\0", "BMP"),
            (b"RIFF\x1a\0\0\0WEBPVP8L", "WEBP"),
            (b"\0\0\0\x18ftypheic", "HEIC"),
            (b"\0\0\0\x18ftypavif", "AVIF"),
            (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
            (b"\x93NUMPY\x01\0", "array of NumPy"),
            (b"PK\x03\x04\x14\0", "ZIP archive"),
        ] {
            let why = read(bytes);
            assert!(why.contains(name) && why.ends_with("is not read; convert it to PNG"), "{why}");
        }
        for bytes in [
            &b"II*\0\x10\0\0\0CR\x02\0"[..],
            b"\0\0\0\x18ftypcrx \0\0",
            b"FUJIFILMCCD-RAW 0201",
            b"IIU\0\x18\0\0\0",
        ] {
            let why = read(bytes);
            assert!(why.contains("raw file of a camera") && why.contains("dcraw -D -4 -T FILE"), "{why}");
        }
        assert!(read(b"Dear reader,").contains("PNG, JPEG, TIFF, OpenEXR and Radiance HDR"));
        assert!(read(b"").contains("is empty"));
    }

    #[test]
    fn raw_files_are_told_by_their_name_as_well() {
        let is_unread = |name: &str| unread(Path::new(name), b"II*\0").is_some();
        assert!(["a.dng", "b.NEF", "c/d.Arw"].into_iter().all(is_unread));
        assert!(!["a.tif", "dng", "a.dng.png"].into_iter().any(is_unread));
    }
}
