//! Files that a user names: regular ones of a bounded size.

use std::io::{Error, ErrorKind, Read as _, Result};
use std::path::Path;

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

/// Reads the text in the regular file at `path`, which has at most `most` bytes.
///
/// # Errors
/// Those of [`read_bytes`], and one for a file that is no UTF-8 text.
pub fn read_text(path: &Path, most: u64) -> Result<String> {
    let no_text = |why| Error::new(ErrorKind::InvalidData, format!("is no UTF-8 text: {why}"));
    String::from_utf8(read_bytes(path, most)?).map_err(no_text)
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
