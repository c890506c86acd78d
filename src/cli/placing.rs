//! Options that place the input: `--up`, `--scale`, `--translate`, `--transform`, `--recentre`.

use crate::error::{Error, Result};
use crate::io::OutputKind;
use crate::mesh::placing::{Placing, Y_TO_Z, Z_TO_Y};

/// The choices of `--up`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Up {
    /// As scans and maps have it.
    Z,
    /// As glTF has it.
    Y,
}

/// A matrix, by columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TypedTransform(pub(super) [f64; 16]);

/// Numbers joined by commas.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shift([f64; 3]);

/// Options of all commands that place their input.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct TypedMoves {
    /// Multiply all coordinates by a number: 0.001 makes metres of millimetres.
    #[arg(long, value_name = "S", value_parser = parse_scale, allow_hyphen_values = true)]
    scale: Option<f64>,
    /// Add a shift to all coordinates, after everything else but --recentre.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_shift, allow_hyphen_values = true)]
    translate: Option<Shift>,
    /// Count coordinates from a round place near the middle, so that floats hold them; the offset is written into the
    /// output (a comment of PLY and OBJ, extras of GLB and tiles) and the report.
    #[arg(long)]
    recentre: bool,
}

impl TypedMoves {
    /// Appends scale and shift, with a map between them.
    pub(super) fn append(
        &self,
        placing: &mut Placing,
        between: Option<TypedTransform>,
    ) -> Result<()> {
        if let Some(by) = self.scale {
            placing.scale(by);
        }
        if let Some(TypedTransform(matrix)) = between {
            placing.then(&matrix);
        }
        if let Some(Shift(by)) = self.translate {
            placing.shift(by);
        }
        placing.recentres = self.recentre;
        let volume = placing.determinant();
        if volume == 0.0 || !volume.is_finite() {
            let what = "--scale and --transform: the mesh would be flat, or endless; give a matrix that has an inverse";
            return Err(Error::Usage(what.to_owned()));
        }
        Ok(())
    }

    /// The placing of a mesh that `tiles` turns upright after it; `None` leaves the axis to the format of the mesh.
    pub(super) fn of_tiles(&self, up: Option<Up>) -> Result<Placing> {
        let mut placing = Placing::default();
        placing.turns_up = up != Some(Up::Z);
        TypedMoves { translate: None, ..self.clone() }.append(&mut placing, None)?;
        placing.upright_shift = self.translate.map(|Shift(by)| by);
        Ok(up.map_or(placing.clone(), |up| placing.settled(up == Up::Y)))
    }
}

/// Options of the commands that write one mesh.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct TypedPlacing {
    /// Axis of INPUT that points upwards; the output is turned so that y does in GLB and z in all others [default: axes
    /// stay as they are].
    #[arg(long, value_enum, value_name = "AXIS")]
    up: Option<Up>,
    #[command(flatten)]
    moves: TypedMoves,
    /// Transform the mesh: 16 numbers, column by column as in glTF, joined by commas; after --up and --scale.
    #[arg(long, value_name = "M16", value_parser = parse_transform, allow_hyphen_values = true)]
    transform: Option<TypedTransform>,
}

impl TypedPlacing {
    /// The placing for an output of a kind.
    pub(super) fn placing(&self, kind: OutputKind) -> Result<Placing> {
        let mut placing = Placing::default();
        if self.up.is_none() && self.transform.is_none() {
            placing.keeps_axes = Some(kind == OutputKind::Glb);
        }
        match (self.up, kind) {
            (Some(Up::Z), OutputKind::Glb) => placing.then(&Z_TO_Y),
            (Some(Up::Y), OutputKind::Ply | OutputKind::Stl | OutputKind::Obj) => {
                placing.then(&Y_TO_Z);
                placing.turns_up = true;
            }
            _ => {}
        }
        self.moves.append(&mut placing, self.transform)?;
        Ok(placing)
    }
}

pub(super) fn numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let parse = |word: &str| word.trim().parse().ok().filter(|x: &f64| x.is_finite());
    let list: Option<Vec<f64>> = text.split(',').map(parse).collect();
    list?.try_into().ok()
}

fn parse_scale(text: &str) -> std::result::Result<f64, String> {
    let scale = text.parse().ok().filter(|x: &f64| x.is_finite() && *x != 0.0);
    scale.ok_or_else(|| "a number other than 0: 0.001, 25.4".to_owned())
}

fn parse_shift(text: &str) -> std::result::Result<Shift, String> {
    numbers::<3>(text).map(Shift).ok_or_else(|| "three numbers: -500000,-4600000,0".to_owned())
}

pub(super) fn parse_transform(text: &str) -> std::result::Result<TypedTransform, String> {
    let fits = |m: &[f64; 16]| [m[3], m[7], m[11], m[15]] == [0.0, 0.0, 0.0, 1.0];
    let matrix = numbers::<16>(text).filter(fits).map(TypedTransform);
    matrix.ok_or_else(|| "16 numbers by columns, the last row 0,0,0,1".to_owned())
}
