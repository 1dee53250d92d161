//! What EVT 2.0 and EVT 3.0 share: the text before the words, and the sizes that 11 bits can count.

use super::limits::Limits;

/// Coordinates have 11 bits.
pub(super) const SIDE: u32 = 1 << 11;

/// The lines that begin a `.raw` file, as Metavision writes them.
pub(super) fn header(version: u8, limits: Limits) -> String {
    let Limits { width, height, .. } = limits;
    format!(
        "% evt {version}.0\n% format EVT{version};height={height};width={width}\n% geometry {width}x{height}\n\
         % generator davis_rs\n% end\n"
    )
}
