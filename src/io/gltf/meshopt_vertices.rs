//! The vertex codec of EXT_meshopt_compression, and its version 1 of KHR_meshopt_compression.
//!
//! Vertices come in blocks. Their bytes stand apart, all first ones of a block before all second ones, each as the difference
//! to the vertex before, in groups of 16 with as many bits as the group needs. Version 1 has a mode for each byte of a block,
//! and differences of 16 and 32 bits.
//!
//! Source: the extension's specification, appendix A, mode 0.

/// Bytes of a block, and the most vertices in it.
const BLOCK_BYTES: usize = 8192;
const BLOCK_VERTICES: usize = 256;

/// Bytes of a group.
const GROUP: usize = 16;

/// Bits of a group by its two bits in the header, in version 0, and in version 1 where the mode is 0 or 1.
const WIDTHS: [[u8; 4]; 3] = [[0, 2, 4, 8], [0, 1, 2, 4], [1, 2, 4, 8]];

/// Modes of a byte in version 1: all differences are 0, or stand there in full.
const ZERO: u8 = 2;
const IN_FULL: u8 = 3;

/// Unpacks `count` vertices of `stride` bytes, a multiple of 4 up to 256; `None` if the data is damaged.
pub(super) fn decode_vertices(count: usize, stride: usize, packed: &[u8]) -> Option<Vec<u8>> {
    let is_newer = match packed.first()? {
        0xa0 => false,
        0xa1 => true,
        _ => return None,
    };
    let n_words = stride / 4;
    let n_tail = stride + if is_newer { n_words } else { 0 };
    let (_, tail) = packed.split_at_checked(packed.len().checked_sub(n_tail)?)?;
    let end = packed.len().checked_sub(n_tail.max(if is_newer { 24 } else { 32 }))?;
    let mut rest = packed.get(1..end)?;
    let (before, channels) = tail.split_at(stride);
    let mut before = before.to_vec();
    let mut out = vec![0; count * stride];
    // Differences of the four bytes of a word.
    let mut planes = [[0; BLOCK_VERTICES]; 4];
    let n_block = (BLOCK_BYTES / stride / GROUP * GROUP).min(BLOCK_VERTICES);
    for block in out.chunks_mut(n_block * stride) {
        let n = block.len() / stride;
        let modes = take(&mut rest, if is_newer { n_words } else { 0 })?;
        for word in 0..n_words {
            for (byte, plane) in planes.iter_mut().enumerate() {
                match modes.get(word).map(|modes| (modes >> (2 * byte)) & 3) {
                    Some(ZERO) => plane.fill(0),
                    Some(IN_FULL) => plane[..n].copy_from_slice(take(&mut rest, n)?),
                    mode => {
                        let widths = WIDTHS[mode.map_or(0, |mode| 1 + usize::from(mode))];
                        take_groups(&mut rest, &mut plane[..n.next_multiple_of(GROUP)], widths)?;
                    }
                }
            }
            let channel = channels.get(word).copied().unwrap_or(0);
            let at = 4 * word;
            let mut value = [before[at], before[at + 1], before[at + 2], before[at + 3]];
            for (i, vertex) in block.chunks_exact_mut(stride).enumerate() {
                value = add(channel, value, [0, 1, 2, 3].map(|byte| planes[byte][i]))?;
                vertex[at..at + 4].copy_from_slice(&value);
            }
            before[at..at + 4].copy_from_slice(&value);
        }
    }
    rest.is_empty().then_some(out)
}

/// Packs vertices of `N` bytes, a multiple of 4 up to 256, in version 0: the bytes of `encode_vertex_buffer` of meshoptimizer.
pub(super) fn encode_vertices<const N: usize>(vertices: &[[u8; N]]) -> Vec<u8> {
    let first = vertices.first().copied().unwrap_or([0; N]);
    let mut out = Vec::with_capacity(N * (vertices.len() + vertices.len() / 32 + 64));
    out.push(0xa0);
    let mut before = first;
    for block in vertices.chunks((BLOCK_BYTES / N / GROUP * GROUP).min(BLOCK_VERTICES)) {
        let mut plane = [0; BLOCK_VERTICES];
        for (byte, before) in before.iter_mut().enumerate() {
            for (delta, vertex) in plane.iter_mut().zip(block) {
                let step = vertex[byte].wrapping_sub(*before);
                *before = vertex[byte];
                *delta = (step << 1) ^ 0u8.wrapping_sub(step >> 7);
            }
            put_groups(&plane[..block.len().next_multiple_of(GROUP)], &mut out);
        }
    }
    out.resize(out.len() + 32usize.saturating_sub(N), 0);
    out.extend_from_slice(&first);
    out
}

/// Writes groups, each with as many bits a byte as make it shortest.
fn put_groups(plane: &[u8], out: &mut Vec<u8>) {
    let groups = plane.as_chunks::<GROUP>().0;
    let header = out.len();
    out.resize(header + groups.len().div_ceil(4), 0);
    for (place, group) in groups.iter().enumerate() {
        let n_over = |most| group.iter().map(|&byte| u8::from(byte >= most)).sum::<u8>();
        let (two, four) = (4 + n_over(3), 8 + n_over(15));
        let width: u8 = if *group == [0; GROUP] {
            0
        } else if two <= four && two < 16 {
            1
        } else if four < 16 {
            2
        } else {
            3
        };
        match width {
            0 => {}
            1 => put_group::<2>(group, out),
            2 => put_group::<4>(group, out),
            _ => out.extend_from_slice(group),
        }
        out[header + place / 4] |= width << (2 * (place % 4));
    }
}

/// Writes a group of few bits a byte; what needs more follows in full.
fn put_group<const BITS: usize>(group: &[u8; GROUP], out: &mut Vec<u8>) {
    let most = (1 << BITS) - 1;
    let (mut packed, mut n) = ([0; 2 * GROUP], GROUP * BITS / 8);
    for (byte, few) in packed.iter_mut().zip(group.chunks_exact(8 / BITS)) {
        *byte = few.iter().fold(0, |byte, &one| byte << BITS | one.min(most));
    }
    for &byte in group {
        packed[n] = byte;
        n += usize::from(byte >= most);
    }
    out.extend_from_slice(&packed[..n]);
}

fn take<'a>(rest: &mut &'a [u8], n: usize) -> Option<&'a [u8]> {
    let (taken, behind) = rest.split_at_checked(n)?;
    *rest = behind;
    Some(taken)
}

/// Reads groups, each with as many bits a byte as its place in the header says.
fn take_groups(rest: &mut &[u8], plane: &mut [u8], widths: [u8; 4]) -> Option<()> {
    let header = take(rest, plane.len().div_ceil(4 * GROUP))?;
    for (place, group) in plane.as_chunks_mut::<GROUP>().0.iter_mut().enumerate() {
        match widths[usize::from((header[place / 4] >> (2 * (place % 4))) & 3)] {
            0 => group.fill(0),
            1 => take_group::<1>(rest, group)?,
            2 => take_group::<2>(rest, group)?,
            4 => take_group::<4>(rest, group)?,
            _ => group.copy_from_slice(take(rest, GROUP)?),
        }
    }
    Some(())
}

/// Reads a group of few bits a byte; bytes of which all bits are set stand in full behind the group.
fn take_group<const BITS: usize>(rest: &mut &[u8], group: &mut [u8; GROUP]) -> Option<()> {
    let packed = take(rest, GROUP * BITS / 8)?;
    let most = (1 << BITS) - 1;
    for (i, byte) in group.iter_mut().enumerate() {
        let place = i * BITS % 8;
        // Single bits stand from the lowest to the highest, others the other way.
        let shift = if BITS == 1 { place } else { 8 - BITS - place };
        *byte = (packed[i * BITS / 8] >> shift) & most;
        if *byte == most {
            *byte = take(rest, 1)?[0];
        }
    }
    Some(())
}

/// The word behind `before`: four bytes, two numbers of 16 bits, or one of 32 bits that is turned and compared bit by bit.
fn add(channel: u8, before: [u8; 4], delta: [u8; 4]) -> Option<[u8; 4]> {
    let half = |word: [u8; 4], at: usize| u16::from_le_bytes([word[at], word[at + 1]]);
    match channel & 3 {
        0 => Some([0, 1, 2, 3].map(|k| {
            let step = (delta[k] >> 1) ^ 0u8.wrapping_sub(delta[k] & 1);
            before[k].wrapping_add(step)
        })),
        1 => {
            let [low, high] = [0, 2].map(|at| {
                let delta = half(delta, at);
                let step = (delta >> 1) ^ 0u16.wrapping_sub(delta & 1);
                half(before, at).wrapping_add(step).to_le_bytes()
            });
            Some([low[0], low[1], high[0], high[1]])
        }
        2 => {
            let delta = u32::from_le_bytes(delta).rotate_right(u32::from(channel >> 4));
            Some((u32::from_le_bytes(before) ^ delta).to_le_bytes())
        }
        _ => None,
    }
}
