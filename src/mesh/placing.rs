//! The placing of an input before all else: turned, scaled, moved, counted from near its middle.

use super::bounds::Bounds;

/// A matrix that changes nothing.
const NONE: [f64; 16] = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

/// Turns y upwards into z upwards, by columns.
pub const Y_TO_Z: [f64; 16] = [1., 0., 0., 0., 0., 0., 1., 0., 0., -1., 0., 0., 0., 0., 0., 1.];

/// Turns z upwards into y upwards, by columns.
pub const Z_TO_Y: [f64; 16] = [1., 0., 0., 0., 0., 0., -1., 0., 0., 1., 0., 0., 0., 0., 0., 1.];

/// Fate of coordinates in degrees.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Degrees {
    /// They stay.
    #[default]
    Kept,
    /// They become metres east and north of their middle.
    Metres {
        /// The system that was typed; `None` for the one that the mesh names.
        system: Option<String>,
        /// The axis that points upwards; `None` for that of the format.
        is_y_up: Option<bool>,
    },
}

/// An affine map of the input, and whether its coordinates are then counted from near its middle.
#[derive(Clone, Debug, PartialEq)]
pub struct Placing {
    /// The matrix by columns, as glTF has matrices; the last row is 0, 0, 0, 1.
    columns: [f64; 16],
    /// Subtract a round offset near the middle of the bounding box.
    pub recentres: bool,
    /// True if y upwards becomes z upwards, by the matrix or later (tiles): a place of the world in a glTF file, which has z
    /// upwards (`CESIUM_RTC`), is then not turned with the rest. Changes nothing by itself.
    pub turns_up: bool,
    /// Set if axes stay as they are: true if the output has y upwards, as glTF.
    pub keeps_axes: Option<bool>,
    /// A shift of a mesh that is turned after all else (tiles): it comes last, and has z upwards. `settled` takes it in.
    pub upright_shift: Option<[f64; 3]>,
    /// Fate of coordinates in degrees, after all else but the recentring. Changes nothing where a system has none.
    pub degrees: Degrees,
}

impl Default for Placing {
    fn default() -> Self {
        Placing {
            columns: NONE,
            recentres: false,
            turns_up: false,
            keeps_axes: None,
            upright_shift: None,
            degrees: Degrees::Kept,
        }
    }
}

impl Placing {
    /// True if nothing is changed.
    pub fn is_none(&self) -> bool {
        self.columns == NONE && !self.recentres
    }

    /// True if axes are at most swapped and turned around, so that lengths along them stay as they are.
    pub fn keeps_lengths(&self) -> bool {
        let is_unit = |i: usize| self.columns[i] == 0.0 || self.columns[i].abs() == 1.0;
        (0..12).all(is_unit)
    }

    /// Appends a map, by columns, that comes after what is there.
    pub fn then(&mut self, outer: &[f64; 16]) {
        let old = self.columns;
        self.columns = std::array::from_fn(|i| {
            let (column, row) = (i / 4, i % 4);
            (0..4).map(|k| outer[4 * k + row] * old[4 * column + k]).sum()
        });
    }

    /// Appends a change of scale.
    pub fn scale(&mut self, by: f64) {
        self.then(&[by, 0., 0., 0., 0., by, 0., 0., 0., 0., by, 0., 0., 0., 0., 1.]);
    }

    /// Appends a shift.
    pub fn shift(&mut self, [x, y, z]: [f64; 3]) {
        self.then(&[1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, y, z, 1.]);
    }

    /// The same with the shift of the upright mesh in the axes of the mesh itself.
    pub fn settled(&self, is_y_up: bool) -> Placing {
        let mut settled = self.clone();
        if let Some([x, y, z]) = settled.upright_shift.take() {
            settled.shift(if is_y_up { [x, z, 0.0 - y] } else { [x, y, z] });
        }
        settled
    }

    /// The image of a point.
    pub fn point(&self, p: [f64; 3]) -> [f64; 3] {
        let m = &self.columns;
        // The products of an axis that only changes its sign are exact, so a turn by a right angle is.
        [0, 1, 2].map(|r| m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r])
    }

    /// Rows of the matrix that turns normals: cofactors, with the sign that keeps them outside where faces are turned around.
    pub fn of_normals(&self) -> [[f64; 3]; 3] {
        let m = |r: usize, c: usize| self.columns[4 * c + r];
        let sign = if self.determinant() < 0.0 { -1.0 } else { 1.0 };
        [0, 1, 2].map(|r| {
            [0, 1, 2].map(|c| {
                let [(r1, r2), (c1, c2)] = [r, c].map(|i| ((i + 1) % 3, (i + 2) % 3));
                sign * (m(r1, c1) * m(r2, c2) - m(r1, c2) * m(r2, c1))
            })
        })
    }

    /// The image of a vector; `None` if vectors stay as they are.
    pub fn vector(&self, [x, y, z]: [f64; 3]) -> Option<[f64; 3]> {
        let m = &self.columns;
        let image = || [0, 1, 2].map(|r| m[r] * x + m[4 + r] * y + m[8 + r] * z);
        (m[..12] != NONE[..12]).then(image)
    }

    /// Volume of the image of a unit cube; negative for a mirror.
    pub fn determinant(&self) -> f64 {
        let m = &self.columns;
        let minor = |a: usize, b: usize| m[4 + a] * m[8 + b] - m[4 + b] * m[8 + a];
        m[0] * minor(1, 2) + m[1] * minor(2, 0) + m[2] * minor(0, 1)
    }

    /// The offset to subtract from a mesh with these bounds: whole numbers with few digits for a mesh of more than 1,
    /// otherwise multiples of a power of 2, so that it is exact.
    pub fn offset(bounds: &Bounds) -> [f64; 3] {
        if bounds.is_empty() {
            return [0.0; 3];
        }
        let extent = (0..3).map(|k| bounds.high[k] - bounds.low[k]).fold(0.0, f64::max);
        let step = match extent {
            extent if extent >= 1.0 => 10f64.powi(extent.log10().floor() as i32),
            extent if extent > 0.0 => extent.log2().floor().exp2(),
            _ => 1.0,
        };
        let middle = |k: usize| 0.5 * bounds.low[k] + 0.5 * bounds.high[k];
        // Adding 0 turns -0 into 0.
        [0, 1, 2].map(|k| (middle(k) / step).round() * step + 0.0)
    }

    /// The matrix by columns.
    pub fn columns(&self) -> [f64; 16] {
        self.columns
    }

    /// The words that are stored in settings.
    pub fn setting(&self) -> String {
        let numbers: Vec<String> = self.columns.iter().map(f64::to_string).collect();
        let recentres = if self.recentres { ";recentre" } else { "" };
        format!("{}{recentres}", numbers.join(","))
    }
}

/// Begins the comment of a file that says what was subtracted from its coordinates.
const OFFSET: &str = "offset: ";

/// The comment on an offset.
pub fn offset_comment(offset: [f64; 3]) -> String {
    let words = offset_words(offset);
    format!("{words} ({SUBTRACTED}; add it to return to those of the input)")
}

/// Words of that comment alone: what other programs write is whole by itself.
pub const SUBTRACTED: &str = "subtracted from all coordinates";

/// The offset alone, short enough for the header of an STL file.
pub fn offset_words([x, y, z]: [f64; 3]) -> String {
    format!("{OFFSET}{x} {y} {z}")
}

/// The sum of the offsets that comments name, if there are any.
pub fn offset_in(comments: &[String]) -> Option<[f64; 3]> {
    let named = comments.iter().filter_map(|comment| offset_of(comment));
    named.reduce(|sum, offset| [0, 1, 2].map(|k| sum[k] + offset[k]))
}

/// The offset that one comment names: three numbers of this program, or an axis of a program of scanners (`offsetx 260137.02`).
pub fn offset_of(comment: &str) -> Option<[f64; 3]> {
    // The name of a solid of STL, which is its only comment.
    let comment = comment.strip_prefix("solid ").unwrap_or(comment);
    let number = |word: &str| word.parse().ok().filter(|x: &f64| x.is_finite());
    if let Some(rest) = comment.strip_prefix(OFFSET) {
        return rest.split(' ').map_while(number).collect::<Vec<f64>>().try_into().ok();
    }
    let (name, rest) = comment.split_once(' ')?;
    let axis = ["offsetx", "offsety", "offsetz"].iter().position(|axis| *axis == name)?;
    let mut offset = [0.0; 3];
    offset[axis] = number(rest.trim())?;
    Some(offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_follow_one_another() {
        let mut placing = Placing::default();
        assert!(placing.is_none());
        placing.then(&Y_TO_Z);
        placing.scale(2.0);
        placing.shift([0.0, 0.0, 7.0]);
        assert_eq!(placing.point([1.0, 2.0, 3.0]), [2.0, -6.0, 11.0]);
        assert_eq!(placing.determinant(), 8.0);
        let n = placing.of_normals().map(|row| row[1]);
        assert_eq!(n, [0.0, 0.0, 4.0]);
        placing.then(&Z_TO_Y);
        assert_eq!(placing.point([0.0; 3]), [0.0, 7.0, 0.0]);
        let upright = Placing { upright_shift: Some([1.0, 2.0, 3.0]), ..Placing::default() };
        assert_eq!(upright.settled(false).point([0.0; 3]), [1.0, 2.0, 3.0]);
        let settled = upright.settled(true);
        assert_eq!(settled.point([0.0; 3]), [1.0, 3.0, -2.0]);
        assert_eq!(settled.settled(false), settled);
        let mut mirror = Placing::default();
        mirror.then(&[-1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]);
        assert_eq!(mirror.determinant(), -1.0);
        assert_eq!(mirror.of_normals()[0][0], -1.0);
        assert_eq!(mirror.of_normals()[1][1], 1.0);
    }

    #[test]
    fn offsets_are_round_and_are_found_in_comments() {
        let bounds = |low: [f64; 3], high: [f64; 3]| {
            let mut bounds = Bounds::default();
            bounds.add(low);
            bounds.add(high);
            bounds
        };
        let offset = Placing::offset(&bounds(
            [500_123.4, 4_600_000.1, 90.0],
            [500_623.4, 4_600_300.0, 130.0],
        ));
        assert_eq!(offset, [500_400.0, 4_600_200.0, 100.0]);
        assert_eq!(Placing::offset(&bounds([0.375; 3], [0.75; 3])), [0.5; 3]);
        let comments = ["made by hand".to_owned(), offset_comment(offset)];
        assert_eq!(offset_in(&comments), Some(offset));
        assert_eq!(offset_in(&comments[..1]), None);
        let axes = ["offsetx 260137.5", "offsety 1e6", "epsg 32651", "offsetz 22.5"];
        assert_eq!(offset_in(&axes.map(str::to_owned)), Some([260_137.5, 1e6, 22.5]));
        let named = ["solid offset: 1 2 3 crs EPSG:32633", "offset: 1 2", "offsetx none", "offset"];
        assert_eq!(offset_in(&named.map(str::to_owned)), Some([1.0, 2.0, 3.0]));
    }
}
