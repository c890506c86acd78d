//! The last step: results get their files, and the run its end.

use super::{Ended, Left, RunStep, SimplifyRun};
use crate::config::{Texture, Until};
use crate::error::{Error, Result};
use crate::io::OutputFormat;
use crate::io::ply::{OutputHeader, Place};
use crate::pipeline::concluded::{WRITING, conclude};
use crate::pipeline::run_report::StageReport;
use crate::pipeline::verify;
use crate::stages::stitch::{self, begins_from_result};
use crate::stages::write::{self, Form, Written};
use crate::store::cells::SurvivorInfo;
use crate::system::pending_file;
use std::path::{Path, PathBuf};
use std::time::Instant;

impl SimplifyRun<'_> {
    /// Writes the result of the level at work; the next level begins from it, or from what the finish took in.
    pub(in crate::pipeline) fn write(
        &mut self,
        result: SurvivorInfo,
        from: Option<Left>,
    ) -> Result<RunStep> {
        if result.triangles == 0 || result.statistics.is_flat {
            return self.hold(Err(empty_result(&result, self.target, self.output().to_path_buf())));
        }
        let next = self.prepared.plan.coarser.get(self.level);
        let is_needed = next.is_some_and(|&next| !begins_from_result(result.triangles, next));
        let kept = match from {
            Some(left) if !is_needed => {
                self.remove(&left)?;
                None
            }
            other => other,
        };
        let is_short = result.triangles > self.target;
        if is_short && self.prepared.retry.is_some() && self.config.coarser.is_empty() {
            return Ok(RunStep::End(Ended::ShortOfTarget(result.triangles)));
        }
        if self.config.job.until == Some(Until::Stitch) {
            return Ok(RunStep::End(Ended::Early));
        }
        self.compose_map()?;
        let written = match self.config.texture {
            Texture::Bake => self.write_baked(&result)?,
            Texture::Auto | Texture::Keep => self.write_kept(&result)?,
        };
        self.levels.push(self.level_report(written));
        if self.level == self.config.coarser.len() {
            return self.conclude();
        }
        self.begin_level(self.level + 1, kept.unwrap_or_else(|| Left::Survivors(Box::new(result))))
    }

    /// Sums up, verifies if that was asked for, and gives up the job folder.
    fn conclude(&mut self) -> Result<RunStep> {
        let mut report = self.report();
        verify::look(self.config, &self.run, &mut report)?;
        if !self.config.job.keep_temp {
            conclude(self.run.job, self.config, &report)?;
        }
        Ok(RunStep::End(Ended::Done(Box::new(report))))
    }

    /// Writes a result that keeps the texture of the input, or has none.
    fn write_kept(&mut self, result: &SurvivorInfo) -> Result<Written> {
        let textures = self.textures.next();
        let written_key = format!("written {}", self.level);
        let path = self.output().to_path_buf();
        if let Some(written) = self.run.job.outcome::<Written>(&written_key)? {
            require_written(&path, written, self.run.job.folder())?;
            return Ok(written);
        }
        let kind = Some(self.config.kind()?);
        let (header, form) = self.form(OutputFormat { kind, ..self.config.format });
        let header = OutputHeader {
            settings: OutputHeader::line_of(&self.config.settings_of_level(self.level)),
            textures,
            sort_memory_bytes: write::sort_memory_bytes(&self.run),
            ..header
        };
        let pack = self.survivors(result.clone())?;
        let (disk, replace) = (self.run.disk().clone(), self.config.job.force);
        let place = Place { path, disk, replace };
        let run = self.run;
        let (written, ()) = self.as_write_stage(result.triangles, |_| {
            Ok((write::write(&pack, place, header, form, &run)?, ()))
        })?;
        let (progressive, map) = (self.config.progressive.as_ref(), self.config.map.as_ref());
        self.adopt(stitch::PROGRESSIVE, progressive.map(|progressive| &progressive.path))?;
        self.adopt(write::MAP, map)?;
        if self.level < self.config.coarser.len() {
            // The next level takes the pack away that this file came from.
            self.run.job.record(&written_key, &written)?;
        }
        Ok(written)
    }

    /// Header and form of a file of survivors of an input.
    pub(super) fn form(&self, format: OutputFormat) -> (OutputHeader, Form) {
        let source = &self.prepared.source;
        let header = source.kept_header(source.schema().clone(), 0, 0);
        let form = Form {
            format,
            faces: source.carried().cloned().unwrap_or_default(),
            normals: self.config.attributes.normals,
            has_reach: self.config.error_field,
        };
        (header, form)
    }

    /// Runs `write`, which makes an output of `triangles` triangles, as a stage that is noted when it begins and is
    /// never taken from the manifest: the output may have been moved away since.
    pub(super) fn as_write_stage<T>(
        &mut self,
        triangles: u64,
        write: impl FnOnce(&Self) -> Result<(Written, T)>,
    ) -> Result<(Written, T)> {
        if self.run.job.outcome::<()>(WRITING)?.is_none() {
            self.run.job.record(WRITING, &())?;
        }
        self.stages.begin("write", triangles);
        let (read, start) = (self.run.disk().bytes_read(), Instant::now());
        let (written, made) = write(self)?;
        let bytes = (self.run.disk().bytes_read() - read, written.bytes);
        self.stages.reports.push(StageReport {
            peak_temp_bytes: self.run.disk().peak_bytes(),
            ..StageReport::since("write", start, (triangles, written.triangles), bytes)
        });
        Ok((written, made))
    }

    /// Gives a file beside the result its name, unless an earlier run that was cut off has.
    fn adopt(&self, made: &str, path: Option<&PathBuf>) -> Result<()> {
        let Some(path) = path.cloned() else { return Ok(()) };
        let made = self.run.job.path(made);
        if !made.exists() && path.exists() {
            return Ok(());
        }
        let (disk, replace) = (self.run.disk().clone(), self.config.job.force);
        pending_file::adopt(&made, Place { path, disk, replace })
    }

    /// Output of the level at work.
    pub(super) fn output(&self) -> &Path {
        let coarser = self.level.checked_sub(1).map(|k| &self.config.coarser[k].output);
        coarser.unwrap_or(&self.config.output)
    }
}

/// An empty result is never a success; files of finer levels stay.
fn empty_result(result: &SurvivorInfo, target: u64, output: PathBuf) -> Error {
    let left = match result.triangles {
        0 => "no triangle is left".to_owned(),
        n => format!("the {n} triangles that are left have no area"),
    };
    let what = format!(
        "{left} at a target of {target}; ask for more, or look at the input with 'info --check'; \
         nothing was written"
    );
    Error::Empty { path: output, what }
}

/// Refuses to go on behind a level whose file is gone: what it was made from is gone, too.
pub(super) fn require_written(path: &Path, written: Written, job_folder: &Path) -> Result<()> {
    let found = std::fs::metadata(path).ok().map(|meta| meta.len());
    if found == Some(written.bytes) {
        return Ok(());
    }
    let path = path.display();
    let what = match found {
        None => format!("its first part wrote {path}, which is gone"),
        Some(_) => format!("its first part wrote {path}, which has changed since"),
    };
    let what = format!("{what}; put the file back, or start over with --restart");
    Err(Error::StateMismatch { path: job_folder.into(), what })
}
