//! Systems of heights by the codes that EPSG gives them: their units, and the direction they count in.
//!
//! The codes are those of PROJ 9.5 (`vertical_crs` in its proj.db). No geoid is read: heights above the sea stay what they are.

/// Codes of heights in metres.
const IN_METRES: [u16; 230] = [
    3855, 3886, 3900, 4440, 4458, 5193, 5195, 5214, 5237, 5317, 5597, 5600, 5601, 5602, 5603, 5604,
    5605, 5606, 5607, 5608, 5609, 5610, 5611, 5613, 5615, 5616, 5617, 5618, 5619, 5620, 5621, 5701,
    5703, 5704, 5705, 5709, 5710, 5711, 5712, 5713, 5714, 5716, 5717, 5718, 5719, 5720, 5721, 5722,
    5723, 5724, 5725, 5726, 5727, 5728, 5729, 5730, 5731, 5732, 5733, 5735, 5736, 5737, 5738, 5740,
    5741, 5742, 5743, 5744, 5745, 5746, 5747, 5748, 5749, 5750, 5751, 5752, 5753, 5755, 5756, 5757,
    5758, 5759, 5760, 5761, 5762, 5763, 5764, 5765, 5766, 5767, 5768, 5769, 5770, 5771, 5772, 5773,
    5774, 5775, 5776, 5777, 5778, 5779, 5780, 5781, 5782, 5783, 5784, 5785, 5786, 5787, 5788, 5790,
    5791, 5792, 5793, 5794, 5795, 5796, 5797, 5798, 5799, 5829, 5843, 5868, 5869, 5870, 5871, 5872,
    5874, 5941, 6178, 6179, 6180, 6181, 6182, 6183, 6184, 6185, 6186, 6187, 6638, 6639, 6640, 6641,
    6642, 6643, 6644, 6647, 6693, 6694, 6695, 6916, 7446, 7447, 7651, 7652, 7699, 7700, 7707, 7832,
    7837, 7839, 7841, 7888, 7889, 7890, 7962, 7968, 7979, 8089, 8266, 8267, 8357, 8434, 8675, 8690,
    8691, 8841, 8881, 8904, 8911, 9130, 9245, 9255, 9274, 9279, 9303, 9335, 9351, 9389, 9390, 9392,
    9393, 9394, 9395, 9396, 9397, 9398, 9399, 9400, 9401, 9402, 9451, 9458, 9471, 9650, 9651, 9663,
    9666, 9669, 9675, 9681, 9721, 9722, 9923, 9927, 10190, 10352, 10353, 10354, 10482, 10483,
    10484, 10485, 10565, 10588, 20000, 20034, 20035, 20036,
];

/// Metres of the feet of the United States and of others.
const US_FOOT: f64 = 1200.0 / 3937.0;
const FOOT: f64 = 0.3048;

/// Codes of heights in feet, and metres of one.
const IN_FEET: [(u16, f64); 9] = [
    (5702, US_FOOT),
    (5754, 0.304_800_749_1),
    (6130, FOOT),
    (6131, FOOT),
    (6132, FOOT),
    (6360, US_FOOT),
    (8050, FOOT),
    (8052, US_FOOT),
    (8228, FOOT),
];

/// The value of a word of a definition.
pub(crate) fn value_in<'a>(definition: &'a str, key: &str) -> Option<&'a str> {
    definition.split(key).nth(1).and_then(|rest| rest.split(' ').next())
}

fn metres(unit: &str) -> f64 {
    match unit {
        "us-ft" => US_FOOT,
        "ft" => FOOT,
        _ => 1.0,
    }
}

/// Metres of the unit of x and y in a definition in words of PROJ.
pub(crate) fn unit_of_maps(definition: &str) -> f64 {
    let to_metre = value_in(definition, "+to_meter=").and_then(|number| number.parse().ok());
    to_metre.unwrap_or_else(|| metres(value_in(definition, "+units=").unwrap_or("m")))
}

/// The heights of a coordinate reference system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Heights {
    metres: f64,
    note: Option<&'static str>,
}

const ABOVE_SEA: &str = "taken as above the ellipsoid (WGS 84), the geoid is not read; --translate 0,0,N adds its height there, \
                         in units of the mesh";
const OF_FEET: &str = "taken as metres, x and y are not; a system of heights behind the code says otherwise \
                       (EPSG:2263+6360: US survey feet), or --scale and a system in metres";

impl Heights {
    /// Those of the code of a system of heights, `m` of `EPSG:n+m`. Errors name one that is not known, or that counts downwards.
    pub(crate) fn of_code(code: u16) -> Result<Heights, String> {
        let feet = IN_FEET.iter().find(|(known, _)| *known == code).map(|(_, metres)| *metres);
        let metres = feet.or_else(|| IN_METRES.contains(&code).then_some(1.0)).ok_or_else(|| {
            format!(
                "EPSG:{code} is not a system of heights that is known here (depths are not read); leave it out where heights are \
                 metres above the ellipsoid, or bring them there with --translate"
            )
        })?;
        Ok(Heights { metres, note: Some(ABOVE_SEA) })
    }

    /// Those of a definition in words of PROJ: `+vunits` where it has heights, else metres.
    pub(crate) fn of_definition(definition: &str) -> Heights {
        let value = |key: &str| value_in(definition, key);
        if let Some(unit) = value("+vunits=") {
            return Heights { metres: metres(unit), note: Some(ABOVE_SEA) };
        }
        let is_other = (unit_of_maps(definition) - 1.0).abs() > 0.01;
        Heights { metres: 1.0, note: is_other.then_some(OF_FEET) }
    }

    /// Metres of a unit.
    pub(crate) fn metres(self) -> f64 {
        self.metres
    }

    /// A remark on how they are taken, if there is something to say.
    pub(crate) fn note(self) -> Option<&'static str> {
        self.note
    }
}
