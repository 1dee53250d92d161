//! What EVT 2.0 and EVT 3.0 share: the text before the words, the sizes that 11 bits can count, words as bytes.

use super::limits::Limits;

/// Coordinates have 11 bits.
pub(super) const SIDE: u32 = 1 << 11;

/// Returns the lines that begin a `.raw` file, as Metavision writes them.
pub(super) fn header(version: u8, limits: Limits) -> String {
    let Limits { width, height, .. } = limits;
    format!(
        "% evt {version}.0\n% format EVT{version};height={height};width={width}\n% geometry {width}x{height}\n\
         % generator davis_rs\n% end\n"
    )
}

/// Appends words as their bytes.
pub(super) fn push_words<T: Copy, const N: usize>(words: &[T], bytes: impl Fn(T) -> [u8; N], out: &mut Vec<u8>) {
    out.extend(words.iter().flat_map(|&word| bytes(word)));
}
