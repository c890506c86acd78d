//! The kinds of phases that rounds have, and the names of these phases.

/// A kind of phase that every round has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Recut,
    Pilot,
    Trial,
    Batch,
}

impl Kind {
    /// The name of the phase of this kind in a round.
    pub(super) fn of_round(self, round: u32) -> String {
        match (self, round) {
            (Kind::Batch, 0) => "simplify".to_owned(),
            (Kind::Pilot, 0) => "pilot".to_owned(),
            (Kind::Trial, 0) => "trial".to_owned(),
            (Kind::Recut, _) => format!("recut-{round}"),
            (Kind::Pilot, _) => format!("pilot-{round}"),
            (Kind::Trial, _) => format!("trial-{round}"),
            (Kind::Batch, _) => format!("round-{round}"),
        }
    }

    /// Kind and round of a phase, if it is one of a round.
    pub(super) fn find(phase: &str) -> Option<(Kind, u32)> {
        let kinds = [Kind::Recut, Kind::Pilot, Kind::Trial, Kind::Batch];
        let round = phase.rsplit_once('-').and_then(|(_, round)| round.parse().ok()).unwrap_or(0);
        let kind = kinds.into_iter().find(|kind| kind.of_round(round) == phase)?;
        Some((kind, round))
    }
}
