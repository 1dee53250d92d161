//! One error type; its kind says who can act on it.

use std::io;

/// What went wrong: the rule, the value and where.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused: disk full, no permission, closed pipe.
    #[error("{context}: {source}")]
    Io {
        /// What was being done, and to which file.
        context: String,
        /// The system's own error.
        source: io::Error,
    },
    /// Bytes that do not follow the format they claim.
    #[error("{message} ({}byte {byte})", line.map_or(String::new(), |line| format!("line {line}, ")))]
    Format {
        /// The rule that was broken, and by what.
        message: String,
        /// In a text: line of the fault, from 1.
        line: Option<usize>,
        /// Offset of the first byte of that line or record, from 0.
        byte: usize,
    },
    /// A value outside of its range; nothing was changed.
    #[error("{0}")]
    Argument(String),
    /// More memory than there is; nothing was changed.
    #[error("{0}")]
    Memory(String),
    /// Times that go back; nothing was changed.
    #[error("{0}")]
    Order(String),
}

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Attaches what was being done to a system error.
    pub fn io(context: impl Into<String>) -> impl FnOnce(io::Error) -> Self {
        let context = context.into();
        move |source| Self::Io { context, source }
    }

    /// Returns the error of a rule of a format that is broken at a byte of the data.
    #[cold]
    pub(crate) fn at_byte(rule: impl Into<String>, byte: usize) -> Self {
        Self::Format { message: rule.into(), line: None, byte }
    }
}
