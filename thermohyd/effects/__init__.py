"""The effects that separate a bench from the ideal valve (MODEL section 6): `registry` names them all."""
