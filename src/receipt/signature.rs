//! Signatures of receipts: those of minisign, in a file beside, which `minisign -V` checks, too.

use minisign::{PublicKey, PublicKeyBox, SecretKey, SecretKeyBox, SignatureBox};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// The first line of a signature by this program; minisign leaves it out of what is signed.
pub(crate) const COMMENT: &str = "signature of a stonecut receipt";

/// The file of the signature.
pub(crate) fn path_beside(receipt: &Path) -> PathBuf {
    let mut path = receipt.as_os_str().to_owned();
    path.push(".minisig");
    path.into()
}

/// A secret key that can sign.
pub(crate) struct SigningKey(SecretKey);

impl SigningKey {
    /// Reads the text of a file of minisign.
    ///
    /// Errors: what is wrong with it, as words.
    pub(crate) fn parse(text: &str) -> Result<SigningKey, String> {
        let key = SecretKeyBox::from_string(text).map_err(|e| {
            format!("not a secret key of minisign ({e}); make one with 'minisign -G -W'")
        })?;
        key.into_unencrypted_secret_key().map(SigningKey).map_err(|e| {
            format!(
                "this key cannot be used without a password ({e}); make one with 'minisign -G -W', or leave --sign out and sign \
                 the receipt with 'minisign -S -m'"
            )
        })
    }

    /// The text of a signature.
    pub(crate) fn sign(&self, receipt: &[u8]) -> Result<String, String> {
        let signed = PublicKey::from_secret_key(&self.0).and_then(|public| {
            let trusted = Some("stonecut receipt");
            minisign::sign(Some(&public), &self.0, Cursor::new(receipt), trusted, Some(COMMENT))
        });
        signed.map(SignatureBox::into_string).map_err(|e| e.to_string())
    }
}

/// Reads a public key: the text of its file, or the key itself.
pub(crate) fn public_key(text: &str) -> Result<PublicKey, String> {
    let text = text.trim();
    let found = match text.contains('\n') {
        true => PublicKeyBox::from_string(text).and_then(PublicKeyBox::into_public_key),
        false => PublicKey::from_base64(text),
    };
    found.map_err(|e| format!("not a public key of minisign ({e})"))
}

/// Checks a signature; gives what is wrong with it.
pub(crate) fn check(receipt: &[u8], signature: &str, key: &PublicKey) -> Result<(), String> {
    let signature = SignatureBox::from_string(signature).map_err(|e| e.to_string())?;
    minisign::verify(key, &signature, Cursor::new(receipt), true, false, false)
        .map_err(|e| e.to_string())
}
