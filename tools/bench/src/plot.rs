//! Plots as SVG: lines over logarithmic axes, and stacked bars.

use crate::Outcome;
use plotters::coord::ranged1d::{KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use std::path::Path;

const SIZE: (u32, u32) = (800, 480);
/// Eight that are safe for the colour-blind (Okabe and Ito), black last, and three darker ones.
const COLOURS: [RGBColor; 11] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 120, 120),
    RGBColor(0, 0, 0),
    RGBColor(110, 60, 140),
    RGBColor(130, 70, 20),
    RGBColor(0, 90, 70),
];

/// Room on the right for the names, as a factor of the largest x.
const LEGEND: f64 = 4.0;

/// A named line through points, ascending in x.
pub type Series = (String, Vec<(f64, f64)>);

/// Draws lines with marks; both axes are logarithmic. Nothing is drawn of nothing.
pub fn lines(path: &Path, title: &str, x: &str, y: &str, series: &[Series]) -> Outcome<()> {
    let points = || series.iter().flat_map(|(_, points)| points.iter());
    let good = |v: &f64| *v > 0.0 && v.is_finite();
    let ((Some(xs), Some(ys)), true) = (
        (range(points().map(|p| p.0).filter(good)), range(points().map(|p| p.1).filter(good))),
        points().count() > 0,
    ) else {
        return Ok(());
    };
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(72)
        .build_cartesian_2d((xs.0..xs.1 * LEGEND).log_scale(), (ys.0..ys.1).log_scale())?;
    chart
        .configure_mesh()
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&|v| short(*v))
        .y_label_formatter(&|v| short(*v))
        .light_line_style(WHITE)
        .draw()?;
    for (i, (name, points)) in series.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let points: Vec<_> = points.iter().copied().filter(|p| good(&p.0) && good(&p.1)).collect();
        chart
            .draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 4), (x + 14, y + 4)], colour.filled()));
        chart.draw_series(points.iter().map(|p| Circle::new(*p, 3, colour.filled())))?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::MiddleRight)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    root.present()?;
    Ok(())
}

/// One bar: its name and its parts from below, each named.
pub type Bar = (String, Vec<(String, f64)>);

/// Draws stacked bars; the same part has the same colour in every bar.
pub fn bars(path: &Path, title: &str, y: &str, bars: &[Bar]) -> Outcome<()> {
    let highest = bars.iter().map(|(_, parts)| parts.iter().map(|p| p.1).sum::<f64>());
    let Some((_, top)) = range(highest) else { return Ok(()) };
    let mut names: Vec<&str> = Vec::new();
    for (name, _) in bars.iter().flat_map(|(_, parts)| parts) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(72)
        .build_cartesian_2d(Slots(bars.len()), 0.0..top)?;
    let name_of = |at: &f64| {
        // Labels stand at whole numbers, the middles of the bars.
        bars.get(*at as usize).map_or_else(String::new, |(name, _)| name.clone())
    };
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_labels(bars.len())
        .x_label_formatter(&name_of)
        .y_desc(y)
        .light_line_style(WHITE)
        .draw()?;
    for (i, name) in names.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let boxes: Vec<_> = bars
            .iter()
            .enumerate()
            .filter_map(|(at, (_, parts))| {
                let place = parts.iter().position(|part| part.0 == *name)?;
                let low: f64 = parts[..place].iter().map(|part| part.1).sum();
                let corners = [(at as f64 - 0.35, low), (at as f64 + 0.35, low + parts[place].1)];
                Some(Rectangle::new(corners, colour.filled()))
            })
            .collect();
        chart
            .draw_series(boxes)?
            .label(*name)
            .legend(move |(x, y)| Rectangle::new([(x, y - 4), (x + 14, y + 4)], colour.filled()));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::MiddleRight)
        .background_style(WHITE.mix(0.8))
        .draw()?;
    root.present()?;
    Ok(())
}

/// An axis of n slots with labels in their middles, and room for the names on the right.
struct Slots(usize);

impl Ranged for Slots {
    type FormatOption = plotters::coord::ranged1d::NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.range()).map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        (0..self.0).map(|i| i as f64).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        -0.5..self.0 as f64 * 1.2 - 0.3
    }
}

impl plotters::coord::ranged1d::ValueFormatter<f64> for Slots {
    fn format(value: &f64) -> String {
        value.to_string()
    }
}

/// A little more than what the values span.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    (low <= high).then_some((low * 0.8, high * 1.25))
}

fn short(value: f64) -> String {
    match value {
        v if v >= 1e9 => format!("{}G", v / 1e9),
        v if v >= 1e6 => format!("{}M", v / 1e6),
        v if v >= 1e3 => format!("{}k", v / 1e3),
        v if v >= 0.01 => format!("{v}"),
        v => format!("{v:.0e}"),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn plots_are_drawn_and_nothing_is_drawn_of_nothing() {
        let path =
            std::env::temp_dir().join(format!("stonecut-bench-plot-{}.svg", std::process::id()));
        lines(&path, "t", "x", "y", &[("none".into(), vec![])]).unwrap();
        bars(&path, "t", "y", &[]).unwrap();
        assert!(!path.exists());
        lines(&path, "t", "x", "y", &[("one".into(), vec![(1e6, 2.0), (4e6, 0.0)])]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("one"));
        let bar = ("1M".to_owned(), vec![("cut".to_owned(), 1.0), ("sew".to_owned(), 2.0)]);
        bars(&path, "t", "seconds", &[bar]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("sew"));
        std::fs::remove_file(path).unwrap();
    }
}
