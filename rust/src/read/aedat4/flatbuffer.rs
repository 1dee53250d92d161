//! Tables of a flatbuffer that others wrote: every offset is checked.

/// A flatbuffer, from behind its size.
#[derive(Clone, Copy)]
pub(super) struct Flatbuffer<'a>(&'a [u8]);

/// A table's offset.
#[derive(Clone, Copy)]
pub(super) struct Table(usize);

impl<'a> Flatbuffer<'a> {
    /// Returns the flatbuffer whose size is at the beginning of `bytes`.
    pub(super) fn with_size(bytes: &'a [u8]) -> Option<Self> {
        let (size, rest) = bytes.split_first_chunk()?;
        rest.get(..usize::try_from(u32::from_le_bytes(*size)).ok()?).map(Self)
    }

    pub(super) fn identifier(self) -> Option<&'a [u8]> {
        self.0.get(4..8)
    }

    pub(super) fn root(self) -> Option<Table> {
        self.behind(0).map(Table)
    }

    pub(super) fn i32(self, offset: usize) -> Option<i32> {
        Some(i32::from_le_bytes(*self.0.get(offset..)?.first_chunk()?))
    }

    pub(super) fn i64(self, offset: usize) -> Option<i64> {
        Some(i64::from_le_bytes(*self.0.get(offset..)?.first_chunk()?))
    }

    /// Returns the offset of a table's field; None where it has its default.
    pub(super) fn field(self, Table(table): Table, index: usize) -> Option<usize> {
        let vtable = i64::try_from(table).ok()? - i64::from(self.i32(table)?);
        let vtable = usize::try_from(vtable).ok()?;
        let at = 4 + 2 * index;
        let offset = if at < usize::from(self.u16(vtable)?) { self.u16(vtable + at)? } else { 0 };
        (offset != 0).then(|| table + usize::from(offset))
    }

    /// Returns the bytes of the vector (or string) that `offset` refers to, of elements of `size` bytes.
    pub(super) fn vector(self, offset: usize, size: usize) -> Option<&'a [u8]> {
        let vector = self.behind(offset)?;
        let length = usize::try_from(self.i32(vector)?).ok()?.checked_mul(size)?;
        self.0.get(vector + 4..)?.get(..length)
    }

    /// Returns the tables of the vector that `offset` refers to; each is None where it lies outside.
    pub(super) fn tables(self, offset: usize) -> Option<impl ExactSizeIterator<Item = Option<Table>>> {
        let (first, count) = (self.behind(offset)? + 4, self.vector(offset, 4)?.len() / 4);
        Some((0..count).map(move |i| self.behind(first + 4 * i).map(Table)))
    }

    /// Returns a number of a table, from its bytes; its default where the table lacks it; None where it lies outside.
    pub(super) fn number<const N: usize, T>(
        self,
        table: Table,
        index: usize,
        from: impl FnOnce([u8; N]) -> T,
        default: T,
    ) -> Option<T> {
        match self.field(table, index) {
            Some(offset) => Some(from(*self.0.get(offset..)?.first_chunk()?)),
            None => Some(default),
        }
    }

    fn behind(self, offset: usize) -> Option<usize> {
        offset.checked_add(usize::try_from(self.i32(offset)?).ok()?)
    }

    fn u16(self, offset: usize) -> Option<u16> {
        Some(u16::from_le_bytes(*self.0.get(offset..)?.first_chunk()?))
    }
}
