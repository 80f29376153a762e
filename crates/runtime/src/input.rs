//! Files that a user names: regular ones of a bounded size.

use std::fmt::Display;
use std::io::{Error, ErrorKind, Read as _, Result};
use std::path::{Path, PathBuf};

use modulo_images::open_regular;

/// The largest text that a person writes, such as a launch file, bytes.
pub const LARGEST_TEXT: u64 = 16 << 20;

/// Reads the regular file at `path`, which has at most `most` bytes.
///
/// # Errors
/// The error of the system, or one that says what the file is not.
pub fn read_bytes(path: &Path, most: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // The size that the system tells may change while the file is read.
    open_regular(path)?.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let why = format!("is larger than {most} bytes, the most that is read");
        return Err(Error::new(ErrorKind::InvalidData, why));
    }
    Ok(bytes)
}

/// Reads the text in the regular file at `path`, which has at most `most` bytes: UTF-8, or UTF-16 with the byte order mark that editors of
/// Windows write. A mark is no part of the text.
///
/// # Errors
/// Those of [`read_bytes`], and one for a file that is no such text.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    let bytes = read_bytes(path, most)?;
    let unit: fn([u8; 2]) -> u16 = match bytes.get(..2) {
        Some([0xff, 0xfe]) => u16::from_le_bytes,
        Some([0xfe, 0xff]) => u16::from_be_bytes,
        _ => {
            let text = String::from_utf8(bytes).map_err(|why| no_text("UTF-8", why))?;
            return Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text));
        }
    };
    let (units, rest) = bytes[2..].as_chunks();
    if !rest.is_empty() {
        return Err(no_text("UTF-16", "it ends within a character"));
    }
    let units: Vec<u16> = units.iter().map(|bytes| unit(*bytes)).collect();
    String::from_utf16(&units).map_err(|why| no_text("UTF-16", why))
}

fn no_text(encoding: &str, why: impl Display) -> Error {
    Error::new(ErrorKind::InvalidData, format!("is no {encoding} text: {why}"))
}

/// Returns the path that a person names by `path`: `~` and what begins with `~/` lie in the home folder, also where no shell has put it there, as
/// behind `source:=` and `--yolo=`. A file whose own name is `~` is `./~`.
pub fn in_home(path: &Path) -> PathBuf {
    let home = || std::env::home_dir().filter(|home| home.is_absolute());
    match path.strip_prefix("~") {
        Ok(rest) => home().map_or_else(|| path.to_owned(), |home| home.join(rest)),
        Err(_) => path.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_bounded_regular_file_is_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "text").expect("writable");
        assert_eq!(read_text(&file, 4).expect("fits"), "text");
        assert!(read_text(&file, 3).expect_err("too large").to_string().contains("larger than 3 bytes"));
        std::fs::write(&file, [0xff]).expect("writable");
        assert!(read_text(&file, 4).expect_err("no text").to_string().contains("no UTF-8 text"));
        assert_eq!(
            read_bytes(&folder.path().join("none"), 4).expect_err("missing").kind(),
            ErrorKind::NotFound
        );
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.is_ok_and(|status| status.success()), "a pipe");
        for special in [&pipe, Path::new("/dev/zero"), folder.path()] {
            let why = read_text(special, 4).expect_err("special").to_string();
            assert!(why.contains("is not a regular file"), "{why}");
        }
    }

    #[test]
    fn texts_of_windows_editors_are_read() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("names.txt");
        let units =
            |bytes: fn(u16) -> [u8; 2]| "\u{feff}Fußgänger\r\n".encode_utf16().flat_map(bytes).collect();
        let forms: [Vec<u8>; 3] =
            ["\u{feff}Fußgänger\r\n".into(), units(u16::to_le_bytes), units(u16::to_be_bytes)];
        for bytes in forms {
            std::fs::write(&file, &bytes).expect("writable");
            assert_eq!(read_text(&file, 99).expect("a text"), "Fußgänger\r\n", "{bytes:x?}");
            // Cut within a character, or wrong.
            std::fs::write(&file, &bytes[..bytes.len() - 1]).expect("writable");
            assert_eq!(read_text(&file, 99).is_err(), bytes[0] != 0xef, "{bytes:x?}");
        }
        std::fs::write(&file, [0xff, 0xfe, 0, 0xd8]).expect("writable");
        assert!(read_text(&file, 99).expect_err("half a pair").to_string().contains("no UTF-16 text"));
    }

    #[test]
    fn a_tilde_is_the_home_folder() {
        let home = std::env::home_dir().filter(|home| home.is_absolute());
        for (given, below) in [("~", ""), ("~/a/b.png", "a/b.png")] {
            // Without a home folder it stays.
            let expected = home.as_ref().map_or(PathBuf::from(given), |home| home.join(below));
            assert_eq!(in_home(Path::new(given)), expected);
        }
        for other in ["", "./~", "a/~/b", "~x", "~user/a", "/~/a"] {
            assert_eq!(in_home(Path::new(other)), Path::new(other));
        }
    }

    #[test]
    fn a_pointer_of_git_lfs_is_named_with_the_remedy() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("classes.txt");
        let pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        std::fs::write(&file, pointer).expect("writable");
        let why = read_text(&file, 1 << 10).expect_err("a pointer").to_string();
        assert!(why.contains("is a pointer of git LFS") && why.contains("run 'git lfs pull'"), "{why}");
        // What ends within the mark is another text, and a file is read from its start.
        for text in ["", &pointer[..20], "version https://git-lfs.github.com/"] {
            std::fs::write(&file, text).expect("writable");
            assert_eq!(read_text(&file, 1 << 10).expect("a text"), text);
        }
    }
}
