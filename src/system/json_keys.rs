//! Names in the JSON that the commands write: the version of its schema, and names of before it.
//!
//! docs/report.md describes every key, docs/report.schema.json says the same for machines. An old name is written beside the new
//! one for one version of the schema, so that scripts keep working; it is marked as deprecated there.

use std::collections::BTreeMap;

/// Version of the JSON of `simplify --report`, `measure`, `info --json` and `status --json`. It grows when a key
/// changes its name or meaning; new keys alone do not change it.
pub const SCHEMA_VERSION: u32 = 1;

/// New and old names; the old ones are to be removed in schema version 2.
const RENAMED: [(&str, &str); 18] = [
    ("link_condition", "link condition"),
    ("non_manifold", "non-manifold"),
    ("small_components_removed", "specks vanished"),
    ("handles_cut", "tubes cut"),
    ("ends_stripped", "ends stripped"),
    ("vertices_welded", "vertices joined"),
    ("vertices_split", "vertices split"),
    ("duplicate_triangles_removed", "duplicate triangles dropped"),
    ("degenerate_triangles_removed", "triangles without area removed"),
    ("boundary_pairs_merged", "boundary vertices approached"),
    ("cell_triangles", "cell-triangles"),
    ("skip_bad", "skip-bad"),
    ("merge_distance", "merge-distance"),
    ("min_component", "min-component"),
    ("sample_checksum", "checksum of samples"),
    ("sample_position", "place"),
    ("color_delta_e", "colour_delta_e"),
    ("color_rms_delta_e", "colour_rms_delta_e"),
];

/// Adds the old names of all keys that have one, with equal values.
pub fn add_old_names<T: Clone>(map: &mut BTreeMap<String, T>) {
    for (new, old) in RENAMED {
        if let Some(value) = map.get(new).cloned() {
            map.insert(old.to_owned(), value);
        }
    }
}

/// True for an old name, which is left out where all keys are shown or summed up.
pub fn is_old_name(key: &str) -> bool {
    RENAMED.iter().any(|(_, old)| *old == key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_names_stand_beside_the_new_ones() {
        let mut map = BTreeMap::from([("flip".to_owned(), 3), ("link_condition".to_owned(), 4)]);
        add_old_names(&mut map);
        assert_eq!((map.len(), map["link_condition"], map["link condition"]), (3, 4, 4));
        let shown: Vec<&String> = map.keys().filter(|key| !is_old_name(key)).collect();
        assert_eq!(shown, ["flip", "link_condition"]);
        let is_snake = |key: &str| key.bytes().all(|b| b == b'_' || b.is_ascii_lowercase());
        assert!(RENAMED.iter().all(|(new, _)| is_snake(new) && !is_old_name(new)));
    }
}
