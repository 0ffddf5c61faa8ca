//! What is said when a running service is given another model: layout version 1.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use iceoryx2::prelude::ZeroCopySend;

use crate::fixed::Message;

/// Most bytes of a path or of words in a message: the system's own limit on paths.
const N_BYTES_MAX: usize = 4096;

/// Asks a service to take another model into use.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::ReloadRequest")]
pub struct ReloadRequest {
    version: u32,
    n_bytes: u32,
    /// Tells the answer to this request from others.
    pub id: u64,
    path: [u8; N_BYTES_MAX],
}

/// What came of a request.
#[derive(Clone, Copy, Debug, ZeroCopySend)]
#[repr(C)]
#[type_name("natural_kinds::ReloadAnswer")]
pub struct ReloadAnswer {
    version: u32,
    n_bytes: u32,
    /// The request's.
    pub id: u64,
    /// 1 where the model is in use now; read it through [`ReloadAnswer::is_taken`].
    taken: u64,
    words: [u8; N_BYTES_MAX],
}

const _: () = {
    use std::mem::{offset_of, size_of};
    assert!(offset_of!(ReloadRequest, n_bytes) == 4);
    assert!(offset_of!(ReloadRequest, id) == 8);
    assert!(offset_of!(ReloadRequest, path) == 16);
    assert!(size_of::<ReloadRequest>() == 16 + N_BYTES_MAX);
    assert!(offset_of!(ReloadAnswer, n_bytes) == 4);
    assert!(offset_of!(ReloadAnswer, id) == 8);
    assert!(offset_of!(ReloadAnswer, taken) == 16);
    assert!(offset_of!(ReloadAnswer, words) == 24);
    assert!(size_of::<ReloadAnswer>() == 24 + N_BYTES_MAX);
};

impl ReloadRequest {
    /// Version of this layout.
    pub const VERSION: u32 = 1;

    /// Asks for the model of a file, given by its absolute path; without one, for that of the file in use, read again.
    ///
    /// None where the path is longer than the system allows.
    pub fn new(id: u64, path: Option<&Path>) -> Option<Self> {
        let bytes = path.map_or(&[][..], |path| path.as_os_str().as_bytes());
        let mut message =
            Self { version: Self::VERSION, n_bytes: bytes.len() as u32, id, path: [0; N_BYTES_MAX] };
        message.path.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(message)
    }

    /// The file that is asked for; none for the one in use.
    pub fn path(&self) -> Option<&Path> {
        let bytes = &self.path[..(self.n_bytes as usize).min(N_BYTES_MAX)];
        (!bytes.is_empty()).then(|| Path::new(OsStr::from_bytes(bytes)))
    }
}

impl ReloadAnswer {
    /// Version of this layout.
    pub const VERSION: u32 = 1;

    /// Answers a request. Words beyond what there is room for are left out.
    pub fn new(id: u64, is_taken: bool, words: &str) -> Self {
        let words = &words[..words.floor_char_boundary(N_BYTES_MAX)];
        let (n_bytes, taken) = (words.len() as u32, u64::from(is_taken));
        let mut message = Self { version: Self::VERSION, n_bytes, id, taken, words: [0; N_BYTES_MAX] };
        message.words[..words.len()].copy_from_slice(words.as_bytes());
        message
    }

    /// Whether the model is in use now. If not, the one before it still is.
    pub fn is_taken(&self) -> bool {
        self.taken == 1
    }

    /// What came of it, for a person.
    pub fn words(&self) -> String {
        let bytes = &self.words[..(self.n_bytes as usize).min(N_BYTES_MAX)];
        String::from_utf8_lossy(bytes).into_owned()
    }
}

impl Message for ReloadRequest {
    const VERSION: u32 = Self::VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

impl Message for ReloadAnswer {
    const VERSION: u32 = Self::VERSION;

    fn version(&self) -> u32 {
        self.version
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_words_come_back_as_they_were_given() {
        let path = Path::new("/models/crunch.kinds");
        assert_eq!(ReloadRequest::new(7, Some(path)).unwrap().path(), Some(path));
        assert_eq!(ReloadRequest::new(7, None).unwrap().path(), None);
        let answer = ReloadAnswer::new(7, true, "now by another");
        assert_eq!((answer.id, answer.is_taken(), answer.words().as_str()), (7, true, "now by another"));
        assert!(!ReloadAnswer::new(7, false, "").is_taken());
    }

    #[test]
    fn paths_that_are_too_long_are_refused_and_words_are_cut_between_characters() {
        let longest = "x".repeat(N_BYTES_MAX);
        assert!(ReloadRequest::new(7, Some(longest.as_ref())).is_some());
        assert!(ReloadRequest::new(7, Some(format!("{longest}x").as_ref())).is_none());
        let words = format!("{}éé", "x".repeat(N_BYTES_MAX - 3));
        assert_eq!(ReloadAnswer::new(7, true, &words).words(), words[..N_BYTES_MAX - 1]);
    }

    #[test]
    fn lengths_of_a_faulty_writer_are_clamped() {
        let request = ReloadRequest { n_bytes: u32::MAX, ..ReloadRequest::new(7, None).unwrap() };
        assert_eq!(request.path().unwrap().as_os_str().len(), N_BYTES_MAX);
        let answer = ReloadAnswer { n_bytes: u32::MAX, ..ReloadAnswer::new(7, true, "") };
        assert_eq!(answer.words().len(), N_BYTES_MAX);
    }
}
