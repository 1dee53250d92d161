//! Triangles: each goes on from an edge or from vertices of the last ones, by a code of one byte.

use super::numbers::Numbers;
use crate::error::{Error, Result};

/// Pairs of vertices that come often, at the end of the data.
const TABLE: usize = 16;

/// The last 16 values; what is not there yet is 0.
struct Ring<T> {
    values: [T; 16],
    next: usize,
}

impl<T: Copy + Default> Ring<T> {
    fn new() -> Self {
        Self { values: [T::default(); 16], next: 0 }
    }

    fn push(&mut self, value: T) {
        self.values[self.next & 15] = value;
        self.next = self.next.wrapping_add(1);
    }

    /// Returns the value that came so many before the next one.
    fn before(&self, steps: u8) -> T {
        self.values[self.next.wrapping_sub(usize::from(steps)) & 15]
    }
}

/// What is known of the triangles so far.
struct Mesh<'a> {
    table: &'a [u8],
    numbers: Numbers<'a>,
    edges: Ring<(u32, u32)>,
    vertices: Ring<u32>,
    /// The first vertex that no triangle has had.
    following: u32,
}

/// Decodes so many triangles, and hands their vertices on.
pub(super) fn decode(data: &[u8], count: usize, mut push: impl FnMut(u32)) -> Result<()> {
    let end = data.len().checked_sub(TABLE).filter(|&end| end > count && data[0] == 0xe1);
    let Some(end) = end else {
        let rule = "triangles must begin with the byte 0xe1, have a code each, and end with a table";
        return Err(Error::at_byte(rule, 0));
    };
    let mut mesh = Mesh {
        table: &data[end..],
        numbers: Numbers::new(&data[..end], 1 + count),
        edges: Ring::new(),
        vertices: Ring::new(),
        following: 0,
    };
    for &code in &data[1..=count] {
        let [a, b, c] = if code < 0xf0 { mesh.at_edge(code >> 4, code & 15)? } else { mesh.apart(code & 15)? };
        mesh.edges.push((c, b));
        mesh.edges.push((a, c));
        [a, b, c].into_iter().for_each(&mut push);
    }
    mesh.numbers.end("triangles")
}

impl Mesh<'_> {
    /// Returns a triangle at one of the last edges; `third` says where its third vertex comes from.
    fn at_edge(&mut self, edge: u8, third: u8) -> Result<[u32; 3]> {
        let (a, b) = self.edges.before(1 + edge);
        if (1..13).contains(&third) {
            return Ok([a, b, self.vertices.before(1 + third)]);
        }
        let c = match third {
            0 => self.unseen(),
            15 => self.numbers.index()?,
            _ => {
                self.numbers.last = self.numbers.last.wrapping_add(if third == 14 { 1 } else { u32::MAX });
                self.numbers.last
            }
        };
        self.vertices.push(c);
        Ok([a, b, c])
    }

    /// Returns a triangle that shares no edge; `kind` says where its vertices come from.
    fn apart(&mut self, kind: u8) -> Result<[u32; 3]> {
        let pair = if kind < 14 { self.table[usize::from(kind)] } else { self.numbers.byte()? };
        let (second, third) = (pair >> 4, pair & 15);
        if kind >= 14 && pair == 0 {
            self.following = 0;
        }
        let mut a = if kind == 15 { 0 } else { self.unseen() };
        let mut b = if second == 0 { self.unseen() } else { self.vertices.before(second) };
        let mut c = if third == 0 { self.unseen() } else { self.vertices.before(third) };
        if kind == 15 {
            a = self.numbers.index()?;
        }
        if kind >= 14 && second == 15 {
            b = self.numbers.index()?;
        }
        if kind >= 14 && third == 15 {
            c = self.numbers.index()?;
        }
        self.edges.push((b, a));
        self.vertices.push(a);
        for (vertex, from) in [(b, second), (c, third)] {
            if matches!(from, 0 | 15) {
                self.vertices.push(vertex);
            }
        }
        Ok([a, b, c])
    }

    /// Returns the first vertex that no triangle has had.
    fn unseen(&mut self) -> u32 {
        self.following = self.following.wrapping_add(1);
        self.following.wrapping_sub(1)
    }
}
