//! Joins the pieces of all cells to components, decides which of them go, and tells each cell.
//!
//! Everything that could grow with the mesh goes through sorts: vertices by place, pairs of pieces to stars,
//! pieces by component and back by cell. A piece is known as a node: its cell and its number among the open ones.

use super::found::{FOUND_NAME, Found, Open};
use super::sizes::{ComponentSizes, Least};
use super::stars::{Edges, each_edge, edge, stars};
use std::iter::Enumerate;
use std::path::Path;
use std::vec::IntoIter;
use stonecut_io::{ExternalSort, halves, whole};
use stonecut_mesh::bounds::Bounds;
use stonecut_store::cell_id::CellId;
use stonecut_store::cells::{CellStore, CellTally, Pack, PackWriter};
use stonecut_store::pack_format::ChunkKind;
use stonecut_store::stage_context::StageContext;
use stonecut_system::error::{Error, Result};

/// The pack of what is left out.
pub(super) const VERDICTS_NAME: &str = "verdicts.cells";

/// Share of the memory for each sort; up to three are at work.
const SORT_SHARE: u64 = 8;

/// Counts of the joining.
pub(super) struct Joined {
    pub sizes: ComponentSizes,
    /// Rows of the cells without what goes.
    pub cells: Vec<CellTally>,
    /// Sealed length of the pack of verdicts; 0 where nothing goes and there is none.
    pub pack_bytes: u64,
}

/// Words of a piece that is sorted by component: component, node, triangles, bounds.
const MEMBER_WORDS: usize = 18;

/// Joins what the cells have noted in `found`.
pub(super) fn join(
    found: &Pack,
    store: &CellStore,
    least: Least,
    run: &StageContext,
) -> Result<Joined> {
    let notes = Notes { found, run };
    let mut sizes = ComponentSizes::none();
    let stars = {
        let links = notes.links(store.n_cells(), &mut sizes)?;
        let new = || notes.sort::<4>();
        stars(pairs(links, new())?, new, || run.progress.check())?
    };
    let members = notes.members(stars, store.n_cells())?;
    let going = going(members, (notes.sort(), notes.sort()), least, &mut sizes)?;
    let mut verdicts =
        VerdictWriter { notes, store, at: None, cells: Vec::new(), pack: None, triangles: 0 };
    going.drain(|[cell, open, high, low]| {
        verdicts.reach(CellId(cell))?;
        verdicts.drop_open(open, whole(high, low));
        Ok(())
    })?;
    let (cells, pack_bytes) = verdicts.finish()?;
    Ok(Joined { sizes, cells, pack_bytes })
}

fn node(cell: CellId, open: usize) -> u64 {
    whole(cell.0, open as u32)
}

/// Notes of the cells, and the folder for sorts.
#[derive(Clone, Copy)]
struct Notes<'a> {
    found: &'a Pack,
    run: &'a StageContext<'a>,
}

impl Notes<'_> {
    fn sort<const N: usize>(&self) -> ExternalSort<N> {
        ExternalSort::new(self.run.job.folder(), (self.run.memory_bytes / SORT_SHARE) as usize)
    }

    fn load(&self, cell: CellId) -> Result<Found> {
        self.run.progress.check()?;
        let mut payload = Vec::new();
        let chunk = self.found.chunks_of(cell).last();
        let note = match chunk {
            Some(chunk) => {
                self.found.read(chunk, &mut payload)?;
                Found::decode(&payload)
            }
            None => None,
        };
        note.ok_or_else(|| {
            let what = format!("the note of cell {cell} makes no sense; run again with --restart");
            Error::corrupt(Path::new(FOUND_NAME), what)
        })
    }

    /// All open vertices by place, with their nodes; adds up what cells have settled.
    fn links(&self, n_cells: usize, sizes: &mut ComponentSizes) -> Result<ExternalSort<8>> {
        let mut links = self.sort::<8>();
        for cell in CellId::first(n_cells) {
            let found = self.load(cell)?;
            sizes.add(&found.settled);
            for ([x, y, z], open) in found.links {
                let ([a, b], [c, d], [e, f]) = (halves(x), halves(y), halves(z));
                links.push([a, b, c, d, e, f, cell.0, open])?;
            }
        }
        Ok(links)
    }

    /// All open pieces by component. Both stars and notes come in order of nodes.
    fn members(&self, stars: Edges, n_cells: usize) -> Result<ExternalSort<MEMBER_WORDS>> {
        let mut members = self.sort::<MEMBER_WORDS>();
        let cells = CellId::first(n_cells);
        let open = Vec::new().into_iter().enumerate();
        let mut rows = Rows { notes: *self, cells, cell: CellId(0), open };
        each_edge(stars, |of, root| {
            while let Some((node, open)) = rows.next()? {
                if node == of {
                    return members.push(member(root, node, &open));
                }
                members.push(member(node, node, &open))?;
            }
            Err(Error::Internal(format!("node {of} of a star is not a piece")))
        })?;
        while let Some((node, open)) = rows.next()? {
            members.push(member(node, node, &open))?;
        }
        Ok(members)
    }
}

/// Pairs of nodes that hold vertices in one place.
fn pairs(links: ExternalSort<8>, mut pairs: Edges) -> Result<Edges> {
    let mut last: Option<([u32; 6], u64)> = None;
    links.drain(|[a, b, c, d, e, f, cell, open]| {
        let (place, node) = ([a, b, c, d, e, f], whole(cell, open));
        match last {
            Some((same, first)) if same == place => {
                if first != node {
                    pairs.push(edge(first, node))?;
                }
            }
            _ => last = Some((place, node)),
        }
        Ok(())
    })?;
    Ok(pairs)
}

/// Open pieces of all cells, one after the other.
struct Rows<'a, I> {
    notes: Notes<'a>,
    /// Cells that are still to be read.
    cells: I,
    /// The cell that was read last, and its pieces that are still to come, with their numbers.
    cell: CellId,
    open: Enumerate<IntoIter<Open>>,
}

impl<I: Iterator<Item = CellId>> Rows<'_, I> {
    fn next(&mut self) -> Result<Option<(u64, Open)>> {
        loop {
            if let Some((number, open)) = self.open.next() {
                return Ok(Some((node(self.cell, number), open)));
            }
            let Some(cell) = self.cells.next() else { return Ok(None) };
            (self.cell, self.open) = (cell, self.notes.load(cell)?.open.into_iter().enumerate());
        }
    }
}

fn member(root: u64, node: u64, open: &Open) -> [u32; MEMBER_WORDS] {
    let mut words = [0; MEMBER_WORDS];
    let corners: [[f64; 3]; 2] = open.extent.bounds.into();
    let bounds = corners.into_iter().flatten().map(f64::to_bits);
    let numbers = [root, node, open.extent.triangles].into_iter().chain(bounds);
    for (place, number) in words.chunks_exact_mut(2).zip(numbers) {
        place.copy_from_slice(&halves(number));
    }
    words
}

/// A component that is being added up.
#[derive(Clone, Copy)]
struct Total {
    root: u64,
    triangles: u64,
    bounds: Bounds,
}

/// The pieces that go, by cell, with their triangles: `[cell, open, triangles]`.
///
/// The last piece of a component decides if it goes, so a second sort puts that before its pieces.
fn going(
    members: ExternalSort<MEMBER_WORDS>,
    (mut marked, mut going): (ExternalSort<7>, ExternalSort<4>),
    least: Least,
    sizes: &mut ComponentSizes,
) -> Result<ExternalSort<4>> {
    const GOES: u32 = 0;
    const MEMBER: u32 = 1;
    let mut total = None::<Total>;
    let mut close = |total: Option<Total>, marked: &mut ExternalSort<7>| match total {
        Some(Total { root, triangles, bounds }) if sizes.count(triangles, bounds, least) => {
            let [high, low] = halves(root);
            marked.push([high, low, GOES, 0, 0, 0, 0])
        }
        _ => Ok(()),
    };
    members.drain(|words| {
        let number = |i: usize| whole(words[2 * i], words[2 * i + 1]);
        let (root, triangles) = (number(0), number(2));
        let coordinate = |i: usize| f64::from_bits(number(3 + i));
        let bounds = Bounds::from([[0, 1, 2].map(coordinate), [3, 4, 5].map(coordinate)]);
        let before = total.filter(|total| total.root == root);
        if before.is_none() {
            close(total, &mut marked)?;
        }
        let before = before.unwrap_or(Total { root, triangles: 0, bounds: Bounds::EMPTY });
        let (triangles, bounds) = (before.triangles + triangles, before.bounds.joined(&bounds));
        total = Some(Total { root, triangles, bounds });
        marked.push([words[0], words[1], MEMBER, words[2], words[3], words[4], words[5]])
    })?;
    close(total, &mut marked)?;
    let mut goes = None;
    marked.drain(|[high, low, kind, cell, open, triangles_high, triangles_low]| {
        let root = whole(high, low);
        if kind == GOES {
            goes = Some(root);
        } else if goes == Some(root) {
            going.push([cell, open, triangles_high, triangles_low])?;
        }
        Ok(())
    })?;
    Ok(going)
}

/// Writes the sets of pieces that go, cell by cell, as soon as there is one.
struct VerdictWriter<'a> {
    notes: Notes<'a>,
    store: &'a CellStore,
    /// The note of the cell that comes next in `cells`, with what goes of it.
    at: Option<Found>,
    /// The cells that are done.
    cells: Vec<CellTally>,
    pack: Option<PackWriter>,
    /// Triangles of the open pieces of `at` that go.
    triangles: u64,
}

impl VerdictWriter<'_> {
    /// Goes on to `cell`, writing all before it.
    fn reach(&mut self, cell: CellId) -> Result<()> {
        while self.cells.len() < cell.index() {
            self.write()?;
        }
        if self.at.is_none() {
            self.at = Some(self.notes.load(cell)?);
        }
        Ok(())
    }

    fn drop_open(&mut self, open: u32, triangles: u64) {
        if let Some(found) = &mut self.at {
            found.goes.insert(found.open[open as usize].piece);
            self.triangles += triangles;
        }
    }

    /// Writes the next cell.
    fn write(&mut self) -> Result<()> {
        let cell = CellId::at(self.cells.len());
        let found = match self.at.take() {
            Some(found) => found,
            None => self.notes.load(cell)?,
        };
        let gone = found.settled.dropped_triangles + std::mem::take(&mut self.triangles);
        let tally = self.store.info().cells[cell];
        self.cells.push(CellTally { triangles: tally.triangles - gone, ..tally });
        if found.goes.is_empty() {
            return Ok(());
        }
        let run = self.notes.run;
        let pack = match &mut self.pack {
            Some(pack) => pack,
            none => none.insert(PackWriter::create(run.disk(), &run.job.path(VERDICTS_NAME))?),
        };
        pack.append(cell, ChunkKind::Verdict, &found.goes.0)
    }

    /// Rows of the cells that stay, and the sealed length of the pack.
    fn finish(mut self) -> Result<(Vec<CellTally>, u64)> {
        while self.cells.len() < self.store.n_cells() {
            self.write()?;
        }
        let Some(mut pack) = self.pack else { return Ok((self.cells, 0)) };
        pack.seal()?;
        let run = self.notes.run;
        run.disk().sync_folder_of(&run.job.path(VERDICTS_NAME))?;
        Ok((self.cells, pack.length()))
    }
}
