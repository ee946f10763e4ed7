"""The effects that separate a bench from the ideal valve (MODEL section 6): `library` names them all."""
