//! JSON in the one form that RFC 8785 gives it (JCS): no blanks, keys sorted, numbers as ECMAScript prints them.

use serde_json::Value;
use std::collections::BTreeSet;

/// The canonical form. Integers beyond 2^53, which RFC 8785 has no numbers for, are written digit by digit.
pub fn canonical(value: &Value) -> Vec<u8> {
    let mut out = String::new();
    append(value, &mut out);
    out.into_bytes()
}

fn append(value: &Value, out: &mut String) {
    match value {
        Value::Array(list) => {
            out.push('[');
            for (number, value) in list.iter().enumerate() {
                if number > 0 {
                    out.push(',');
                }
                append(value, out);
            }
            out.push(']');
        }
        Value::Object(map) => {
            let mut keys: Vec<&String> = map.keys().collect();
            keys.sort_by(|a, b| a.encode_utf16().cmp(b.encode_utf16()));
            out.push('{');
            for (number, key) in keys.into_iter().enumerate() {
                if number > 0 {
                    out.push(',');
                }
                append(&Value::String(key.clone()), out);
                out.push(':');
                append(&map[key], out);
            }
            out.push('}');
        }
        Value::Number(number) => match (number.is_f64(), number.as_f64()) {
            (true, Some(x)) => out.push_str(&as_ecmascript(x)),
            _ => out.push_str(&number.to_string()),
        },
        // Strings are escaped as ECMAScript does it.
        plain => out.push_str(&plain.to_string()),
    }
}

/// A finite number as `Number::toString` of ECMA-262 prints it: the fewest digits that are read back as the same number.
fn as_ecmascript(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    // The digits of serde_json are the nearest, and even where two are: those of `{:e}` are not always.
    let text = Value::from(x.abs()).to_string();
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let whole = mantissa.find('.').unwrap_or(mantissa.len()) as i32;
    let digits = mantissa.replace('.', "");
    let n_leading = digits.len() - digits.trim_start_matches('0').len();
    let digits = digits.trim_matches('0');
    // Digits before the point; below 0, zeros behind it.
    let point = exponent.parse::<i32>().unwrap_or(0) + whole - n_leading as i32;
    let sign = if x < 0.0 { "-" } else { "" };
    let n_digits = digits.len();
    let zeros = |n: i32| "0".repeat(n.unsigned_abs() as usize);
    match point {
        1..=21 if n_digits <= point as usize => {
            format!("{sign}{digits}{}", zeros(point - n_digits as i32))
        }
        1..=21 => {
            let (whole, rest) = digits.split_at(point as usize);
            format!("{sign}{whole}.{rest}")
        }
        -5..=0 => format!("{sign}0.{}{digits}", zeros(point)),
        _ => {
            let (first, rest) = digits.split_at(1);
            let dot = if rest.is_empty() { "" } else { "." };
            let plus = if point < 1 { "" } else { "+" };
            format!("{sign}{first}{dot}{rest}e{plus}{}", point - 1)
        }
    }
}

/// Lists where two values differ, by the keys that lead there.
pub fn differences(recorded: &Value, found: &Value, at: &str, out: &mut Vec<String>) {
    let below = |key: &str| if at.is_empty() { key.to_owned() } else { format!("{at}: {key}") };
    match (recorded, found) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                let of = |map: &serde_json::Map<String, Value>| {
                    map.get(key).cloned().unwrap_or(Value::Null)
                };
                differences(&of(a), &of(b), &below(key), out);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (number, (a, b)) in a.iter().zip(b).enumerate() {
                differences(a, b, &below(&number.to_string()), out);
            }
        }
        _ if recorded == found => {}
        _ => out.push(format!("{at}: {} recorded, {} found", shown(recorded), shown(found))),
    }
}

fn shown(value: &Value) -> String {
    match value {
        Value::Null => "nothing".to_owned(),
        Value::String(text) => text.clone(),
        other => String::from_utf8_lossy(&canonical(other)).into_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Rows of appendix B of RFC 8785.
    #[test]
    fn numbers_are_those_of_the_rfc() {
        for (bits, text) in [
            (0x0000_0000_0000_0000_u64, "0"),
            (0x8000_0000_0000_0000, "0"),
            (0x0000_0000_0000_0001, "5e-324"),
            (0x8000_0000_0000_0001, "-5e-324"),
            (0x7fef_ffff_ffff_ffff, "1.7976931348623157e+308"),
            (0x4340_0000_0000_0000, "9007199254740992"),
            (0x4430_0000_0000_0000, "295147905179352830000"),
            (0x44b5_2d02_c7e1_4af5, "9.999999999999997e+22"),
            (0x44b5_2d02_c7e1_4af6, "1e+23"),
            (0x444b_1ae4_d6e2_ef4e, "999999999999999700000"),
            (0x444b_1ae4_d6e2_ef50, "1e+21"),
            (0x3eb0_c6f7_a0b5_ed8c, "9.999999999999997e-7"),
            (0x3eb0_c6f7_a0b5_ed8d, "0.000001"),
            (0x41b3_de43_5555_5553, "333333333.3333332"),
            (0xbecb_f647_612f_3696, "-0.0000033333333333333333"),
            (0x4314_3ff3_c1cb_0959, "1424953923781206.2"),
        ] {
            assert_eq!(as_ecmascript(f64::from_bits(bits)), text);
        }
    }

    #[test]
    fn keys_are_sorted_and_texts_escaped_as_the_rfc_says() {
        let text = r#"{"peach":"\u20ac$\u000F\nA'\u0042\u0022\u005c\\\"\/","b":[56.0,{"d":true,"10":null,"1":[]}],"\ud83d\ude02":1,"\ufb33":2,"a":-7}"#;
        let value: Value = serde_json::from_str(text).unwrap();
        assert_eq!(
            String::from_utf8(canonical(&value)).unwrap(),
            "{\"a\":-7,\"b\":[56,{\"1\":[],\"10\":null,\"d\":true}],\"peach\":\"\u{20ac}$\\u000f\\nA'B\\\"\\\\\\\\\\\"/\",\"\u{1f602}\":1,\"\u{fb33}\":2}"
        );
    }

    #[test]
    fn differences_are_named_by_their_keys() {
        let a = json!({"x": {"a.ply": {"bytes": 3}, "gone": 1}, "list": [1, 2], "long": [1]});
        let b = json!({"x": {"a.ply": {"bytes": 4}, "new": 1}, "list": [1, 5], "long": []});
        let mut out = Vec::new();
        differences(&a, &b, "", &mut out);
        assert_eq!(
            out,
            [
                "list: 1: 2 recorded, 5 found",
                "long: [1] recorded, [] found",
                "x: a.ply: bytes: 3 recorded, 4 found",
                "x: gone: 1 recorded, nothing found",
                "x: new: nothing recorded, 1 found",
            ]
        );
        out.clear();
        differences(&a, &a, "", &mut out);
        assert!(out.is_empty());
    }
}
