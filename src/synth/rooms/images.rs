//! Paints the images of the atlas: slot by slot, from the panels that their charts show.

use super::atlas::{Atlas, SLOT};
use super::{Rooms, chart_start, on_panel};
use stonecut_render::Picture;

impl Rooms {
    /// One image.
    pub(super) fn image(&self, page: u64) -> Picture {
        let Atlas { across, n_charts, .. } = self.atlas;
        let width = self.atlas.width();
        let mut picture = Picture::new(width as u32, width as u32, [0; 3]);
        let first = page * across * across;
        for number in first..(first + across * across).min(n_charts) {
            let Some((panel, at)) = self.chart(number) else { break };
            let chart = self.atlas.chart(number, self.seed);
            let start = chart_start(at);
            for y in 0..SLOT {
                for x in 0..SLOT {
                    let local = chart.local([x, y]);
                    let place = on_panel(&panel, [0, 1].map(|n| start[n] + local[n]));
                    let to = 3 * ((chart.corner[1] + y) * width + chart.corner[0] + x);
                    picture.rgb[to..to + 3].copy_from_slice(&panel.paint.color(place, panel.tag));
                }
            }
        }
        picture
    }
}
