//! Colours beyond the borders of charts.

/// A texel that no chart covers.
pub(super) const EMPTY: [u8; 4] = [0; 4];

/// Lets colours grow into empty texels, `steps` times by one texel: the mean of the neighbours that have a colour.
pub(super) fn grow(pixels: &mut [[u8; 4]], width: usize, steps: u32) {
    const HAS_NONE: u8 = 0;
    const HAS_COLOUR: u8 = 1;
    // Gets its colour in the next step; also a frame around all, which never gets one, so that no step looks for the ends of rows.
    const GROWS: u8 = 2;
    let framed = width + 2;
    let mut state = vec![GROWS; framed];
    for row in pixels.chunks_exact(width.max(1)) {
        state.push(GROWS);
        state.extend(row.iter().map(|&pixel| u8::from(pixel != EMPTY)));
        state.push(GROWS);
    }
    state.resize(state.len() + framed, GROWS);
    // Places of texels that grow, among the pixels and among the states.
    let mut border: Vec<(u32, u32)> = Vec::new();
    let mut near = vec![0; framed];
    for y in 0..pixels.len() / width.max(1) {
        let (above, rest) = state[y * framed..(y + 3) * framed].split_at_mut(framed);
        let (own, below) = rest.split_at_mut(framed);
        for (near, ((above, own), below)) in
            near.iter_mut().zip(above.iter().zip(&*own).zip(below.iter()))
        {
            *near = (*above | *own | *below) & HAS_COLOUR;
        }
        for (x, near) in near.windows(3).enumerate() {
            if own[x + 1] == HAS_NONE && near[0] | near[1] | near[2] != 0 {
                own[x + 1] = GROWS;
                border.push(((y * width + x) as u32, ((y + 1) * framed + x + 1) as u32));
            }
        }
    }
    let (mut grown, mut next) = (Vec::new(), Vec::new());
    // Steps to the nine places around one, from the first of them.
    let around = |width: usize| [0, 1, 2].map(|y| [0, 1, 2].map(|x| y * width + x));
    let (in_pixels, in_states) = (around(width), around(framed));
    for _ in 0..steps {
        grown.clear();
        next.clear();
        for &(at, place) in &border {
            let first = place as usize - framed - 1;
            let mut sums = [0u32; 5];
            for (step, to) in in_states.as_flattened().iter().zip(in_pixels.as_flattened()) {
                match state[first + step] {
                    HAS_COLOUR => {
                        let pixel = pixels[at as usize + to - width - 1];
                        // What cannot be seen has no colour.
                        let weight = u32::from(pixel[3]);
                        (0..3).for_each(|k| sums[k] += weight * u32::from(pixel[k]));
                        sums[3] += weight;
                        sums[4] += 1;
                    }
                    HAS_NONE => {
                        state[first + step] = GROWS;
                        next.push(((at as usize + to - width - 1) as u32, (first + step) as u32));
                    }
                    _ => {}
                }
            }
            let colour = |k: usize| ((sums[k] + sums[3] / 2) / sums[3].max(1)) as u8;
            let opacity = (sums[3] / sums[4].max(1)) as u8;
            let pixel = [colour(0), colour(1), colour(2), opacity];
            grown.push(if opacity == 0 { [0, 0, 1, 0] } else { pixel });
        }
        for (&(at, place), &pixel) in border.iter().zip(&grown) {
            (pixels[at as usize], state[place as usize]) = (pixel, HAS_COLOUR);
        }
        std::mem::swap(&mut border, &mut next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_grow_by_a_texel_a_step() {
        let width = 9;
        let mut pixels = vec![EMPTY; width * 5];
        pixels[2 * width + 1] = [10, 20, 30, 255];
        pixels[2 * width + 8] = [200, 0, 0, 255];
        grow(&mut pixels, width, 2);
        let row: Vec<u8> = pixels[2 * width..3 * width].iter().map(|p| p[0]).collect();
        assert_eq!(row, [10, 10, 10, 10, 0, 0, 200, 200, 200]);
        assert_eq!(pixels[0], [10, 20, 30, 255]);
    }
}
