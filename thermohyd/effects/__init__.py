"""The effects that separate a bench from the ideal valve (docs/physics.md section 8): `library` names them all."""
