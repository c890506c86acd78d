//! Codes of coordinate reference systems in text: `EPSG:n`, `EPSG:n+m` with a system of heights, and WKT.
//!
//! Of WKT the code is read that belongs to the whole, not one of the many within; where it has none, as ESRI writes it, the
//! names of UTM's zones are known. Anything else is not understood.

use crate::globe::{codes_of, epsg_name};

/// Names of systems without blanks and signs up to the zone, and the codes before that of the first zone, north and south.
const UTM: [(&str, u16, Option<u16>); 6] = [
    ("wgs1984utmzone", 32600, Some(32700)),
    ("wgs84utmzone", 32600, Some(32700)),
    ("etrs1989utmzone", 25800, None),
    ("etrs89utmzone", 25800, None),
    ("nad1983utmzone", 26900, None),
    ("nad83utmzone", 26900, None),
];

/// Names of other systems, and their codes.
const OTHERS: [(&str, u16); 3] =
    [("gcswgs1984", 4326), ("wgs84", 4326), ("wgs1984webmercatorauxiliarysphere", 3857)];

/// `EPSG:n` or `EPSG:n+m` of a text.
pub(crate) fn epsg(text: &str) -> Option<String> {
    if let Some((code, vertical)) = codes_of(text) {
        return Some(epsg_name(code, vertical));
    }
    let found = Wkt::of(text);
    let child = |n: usize| found.children.get(n).copied().flatten();
    match (found.is_compound, child(0), found.own) {
        (true, Some(code), _) => Some(epsg_name(code, child(1))),
        (_, _, Some(code)) => Some(epsg_name(code, None)),
        _ => by_name(found.name).map(|code| epsg_name(code, None)),
    }
}

/// Codes in a WKT.
#[derive(Default)]
struct Wkt<'a> {
    name: &'a str,
    is_compound: bool,
    /// The code of the whole.
    own: Option<u16>,
    /// The codes of the systems that it is made of.
    children: Vec<Option<u16>>,
}

impl Wkt<'_> {
    fn of(text: &str) -> Wkt<'_> {
        let mut found = Wkt::default();
        let begins = |at: usize, words: &[&str]| {
            let is_break = |c: char| !c.is_ascii_alphanumeric() && c != '_';
            let word = text[..at].trim_end().rsplit(is_break).next().unwrap_or_default();
            words.iter().any(|known| known.eq_ignore_ascii_case(word))
        };
        let (mut depth, mut is_quoted) = (0usize, false);
        for (at, sign) in text.char_indices() {
            match sign {
                '"' => is_quoted = !is_quoted,
                _ if is_quoted => {}
                '[' | '(' => {
                    if depth == 0 {
                        let mut parts = text[at + 1..].splitn(3, '"');
                        let name = parts.nth(1).unwrap_or_default();
                        // Without its end it is not whole.
                        found.name = parts.next().map_or("", |_| name);
                        found.is_compound = begins(at, &["COMPD_CS", "COMPOUNDCRS"]);
                    } else if begins(at, &["AUTHORITY", "ID"]) {
                        let code = code_in(&text[at + 1..]);
                        let place = match depth {
                            1 => Some(&mut found.own),
                            2 => found.children.last_mut(),
                            _ => None,
                        };
                        place.into_iter().for_each(|place| *place = code);
                    } else if depth == 1 {
                        found.children.push(None);
                    }
                    depth += 1;
                }
                ']' | ')' => depth = depth.saturating_sub(1),
                _ => {}
            }
        }
        found
    }
}

/// The code behind `AUTHORITY[` or `ID[`, if it is one of EPSG.
fn code_in(text: &str) -> Option<u16> {
    let (authority, rest) = text.trim_start().strip_prefix('"')?.split_once('"')?;
    let digits = rest.trim_start_matches([',', '"', ' ']);
    let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
    digits[..end].parse().ok().filter(|_| authority == "EPSG")
}

/// The code of a system that programs name without one.
fn by_name(name: &str) -> Option<u16> {
    let name: String =
        name.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_ascii_lowercase();
    let other = OTHERS.iter().find(|(known, _)| *known == name).map(|(_, code)| *code);
    other.or_else(|| {
        let of = |(prefix, north, south): &(&str, u16, Option<u16>)| {
            let zone = name.strip_prefix(prefix)?;
            let (number, half) = zone.split_at_checked(zone.len().checked_sub(1)?)?;
            let number: u16 = number.parse().ok().filter(|n| (1..=60).contains(n))?;
            match half {
                "n" => Some(north + number),
                "s" => south.map(|south| south + number),
                _ => None,
            }
        };
        UTM.iter().find_map(of)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_of_the_whole_are_read_and_no_others() {
        let geographic = r#"GEOGCS["WGS 84",UNIT["degree",0.01,AUTHORITY["EPSG","9122"]],AUTHORITY["EPSG","4326"]]"#;
        let projected = |name: &str, code: &str| {
            format!(
                r#"PROJCS["{name}",{geographic},UNIT["metre",1,AUTHORITY["EPSG","9001"]]{code}]"#
            )
        };
        let own = r#",AUTHORITY["EPSG","25832"]"#;
        let compound = |code: &str| {
            let heights = r#"VERT_CS["heights",AUTHORITY["EPSG","7837"]]"#;
            format!(r#"COMPD_CS["both",{},{heights}{code}]"#, projected("x", own))
        };
        let both = Some("EPSG:25832+7837");
        for (text, wanted) in [
            ("EPSG:25832", Some("EPSG:25832")),
            ("EPSG:25832+7837", both),
            ("urn:ogc:def:crs:EPSG::25832", Some("EPSG:25832")),
            (&projected("x", own), Some("EPSG:25832")),
            (&compound(""), both),
            (&compound(r#",AUTHORITY["EPSG","5555"]"#), both),
            (
                r#"PROJCRS["x", BASEGEOGCRS["y", ID["EPSG",4326]], ID["EPSG",25832]]"#,
                Some("EPSG:25832"),
            ),
            (&projected("WGS_1984_UTM_Zone_56S", ""), Some("EPSG:32756")),
            (&projected("ETRS_1989_UTM_Zone_32N", ""), Some("EPSG:25832")),
            (&projected("Mine", ""), None),
            (r#"LOCAL_CS["x(AUTHORITY["EPSG","1"]"#, None),
            ("EPSG:x", None),
            ("", None),
        ] {
            assert_eq!(epsg(text).as_deref(), wanted, "{text}");
        }
    }
}
