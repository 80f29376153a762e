//! [`Part`]: a download under way, in a file `<file>.part` that only one
//! process writes. It becomes the file in one rename, when it is whole.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// What is there of a file, and the hash of it.
pub struct Part {
    path: PathBuf,
    file: File,
    hash: Sha256,
    len: u64,
}

impl Part {
    /// Opens or makes the part of `whole`, and hashes what it holds.
    ///
    /// # Errors
    /// Also when another process has it.
    pub fn open(whole: &Path) -> io::Result<Self> {
        let path = Self::path(whole);
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path)?;
        file.try_lock().map_err(|why| match why {
            std::fs::TryLockError::WouldBlock => io::Error::other("another process is fetching it"),
            std::fs::TryLockError::Error(why) => why,
        })?;
        let (hash, len) = hash(&file)?;
        Ok(Self { path, file, hash, len })
    }

    /// Where the part of `whole` lies.
    pub fn path(whole: &Path) -> PathBuf {
        let mut name = whole.as_os_str().to_owned();
        name.push(".part");
        PathBuf::from(name)
    }

    /// Bytes that are there.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// sha256 of what is there, in hex.
    pub fn sha256(&self) -> String {
        hex(self.hash.clone())
    }

    /// Throws away what is there.
    ///
    /// # Errors
    /// As the system says.
    pub fn restart(&mut self) -> io::Result<()> {
        self.file.set_len(0)?;
        self.file.seek(SeekFrom::Start(0))?;
        (self.hash, self.len) = (Sha256::new(), 0);
        Ok(())
    }

    /// Appends `bytes`.
    ///
    /// # Errors
    /// As the system says, such as for a full disk.
    pub fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.hash.update(bytes);
        self.len += bytes.len() as u64;
        Ok(())
    }

    /// Makes it `whole`, safe from a power cut.
    ///
    /// # Errors
    /// As the system says.
    pub fn keep(self, whole: &Path) -> io::Result<()> {
        self.file.sync_all()?;
        std::fs::rename(&self.path, whole)
    }

    /// Removes it.
    ///
    /// # Errors
    /// As the system says.
    pub fn remove(self) -> io::Result<()> {
        std::fs::remove_file(&self.path)
    }
}

/// sha256 of the file at `path`, in hex; `None` when there is none.
pub fn sha256_of(path: &Path) -> io::Result<Option<String>> {
    match File::open(path) {
        Ok(file) => Ok(Some(hex(hash(&file)?.0))),
        Err(why) if why.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(why) => Err(why),
    }
}

/// Reads `file` from where it stands to its end.
fn hash(mut file: &File) -> io::Result<(Sha256, u64)> {
    let (mut hash, mut len) = (Sha256::new(), 0);
    let mut buffer = vec![0; 1 << 16];
    loop {
        let read = file.read(&mut buffer)?;
        if read == 0 {
            return Ok((hash, len));
        }
        hash.update(&buffer[..read]);
        len += read as u64;
    }
}

fn hex(hash: Sha256) -> String {
    hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}
