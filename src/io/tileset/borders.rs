//! Numbers of the vertices that tiles have in common: a file beside the tiles of a group.
//!
//! Places do not tell vertices apart where sheets touch, and a vertex on the borders of two rounds is rounded differently in
//! tiles of two levels. So the checker and `extract` know a vertex by its number in the input. Viewers do not read it.

use stonecut_mesh::global_vertex::GlobalVertex;
use xxhash_rust::xxh3::xxh3_64;

/// First bytes of a file.
pub(super) const MAGIC: &[u8; 8] = b"stcids 1";

/// For each vertex of a tile that other tiles may have, its place in the file of the tile and its number, by place.
pub type TileBorder = Vec<(u32, GlobalVertex)>;

/// The file of the tiles of a group, from the path of one of them, and which of them it is.
pub fn border_path(tile: &str) -> Option<(String, usize)> {
    let (cell, n) = tile.strip_suffix(".glb")?.rsplit_once('-')?;
    Some((format!("{cell}.ids"), n.parse().ok()?))
}

/// Encodes the borders of the tiles of a group: about 4 bytes a vertex.
pub fn encode_borders(tiles: &[TileBorder]) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    put(&mut out, tiles.len() as u64);
    for tile in tiles {
        put(&mut out, tile.len() as u64);
        let (mut place, mut id) = (0, 0u64);
        for &(at, number) in tile {
            put(&mut out, u64::from(at - place));
            let off = number.0.wrapping_sub(id) as i64;
            put(&mut out, ((off << 1) ^ (off >> 63)) as u64);
            (place, id) = (at, number.0);
        }
    }
    let checksum = xxh3_64(&out);
    out.extend_from_slice(&checksum.to_le_bytes());
    out
}

/// Decodes a file; the error says what is wrong with it.
pub fn decode_borders(bytes: &[u8]) -> Result<Vec<TileBorder>, String> {
    let damaged = || "its numbers of vertices are damaged".to_owned();
    let (body, checksum) = bytes.split_last_chunk::<8>().ok_or_else(damaged)?;
    if !body.starts_with(MAGIC) || xxh3_64(body) != u64::from_le_bytes(*checksum) {
        return Err(damaged());
    }
    let mut rest = &body[MAGIC.len()..];
    let mut next = || take(&mut rest).ok_or_else(damaged);
    let mut tiles = Vec::new();
    for _ in 0..next()? {
        let (mut place, mut id) = (0u32, 0u64);
        let mut tile = Vec::new();
        for _ in 0..next()? {
            let step = u32::try_from(next()?).map_err(|_| damaged())?;
            place = place.checked_add(step).ok_or_else(damaged)?;
            let off = next()?;
            id = id.wrapping_add((off >> 1) ^ (off & 1).wrapping_neg());
            tile.push((place, GlobalVertex(id)));
        }
        tiles.push(tile);
    }
    Ok(tiles)
}

/// Seven bits a byte, the lowest first.
fn put(out: &mut Vec<u8>, mut value: u64) {
    while value >= 128 {
        out.push(value as u8 | 128);
        value >>= 7;
    }
    out.push(value as u8);
}

fn take(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0u64;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 127) << shift;
        if byte < 128 {
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_come_back_and_damage_is_refused() {
        let number = |(at, id)| (at, GlobalVertex(id));
        let tiles = vec![
            [(0, 7), (1, u64::MAX), (900, 0), (70_000, 1 << 40)].map(number).to_vec(),
            Vec::new(),
            vec![(u32::MAX, GlobalVertex(3))],
        ];
        let bytes = encode_borders(&tiles);
        assert_eq!(decode_borders(&bytes).unwrap(), tiles);
        for at in 0..bytes.len() {
            assert!(decode_borders(&bytes[..at]).is_err());
            let mut other = bytes.clone();
            other[at] ^= 4;
            assert!(decode_borders(&other).is_err(), "{at}");
        }
        assert_eq!(border_path("tiles/0/1/17-3.glb"), Some(("tiles/0/1/17.ids".to_owned(), 3)));
        assert_eq!(border_path("x.glb"), None);
    }
}
