"""Further label lists as laboratories write them; the first entry is the code of the largest substitute."""

FURTHER = {
    "bmclab": (
        "trunk-missing",
        """
        R.ASIS L.ASIS R.PSIS L.PSIS L.Iliac.Crest R.Iliac.Crest R.GTR R.Knee R.HF R.TT R.Ankle R.Heel R.MT1 R.MT5 L.GTR
        L.Knee L.HF L.TT L.Ankle L.Heel L.MT1 L.MT5 R.Knee.Medial R.Ankle.Medial L.Knee.Medial L.Ankle.Medial
        """,
    ),
    "treadmill-segments": (
        "arms-missing",
        """
        R.ASIS R.PSIS S2 L.PSIS L.ASIS R.TH1 R.TH2 R.TH3 R.MKnee R.Knee R.SH1 R.SH2 R.SH3 R.SH4 R.Ankle R.MAnkle R.Heel
        R.MT5 R.MT1 L.TH1 L.TH2 L.TH3 L.TH4 L.MKnee L.Knee L.SH1 L.SH2 L.SH3 L.Ankle L.MAnkle L.Heel L.MT5 L.MT1 R.Acr
        L.Acr C7 T10 Clav Sternum R.Back
        """,
    ),
    "treadmill-segments with arms": (
        "",
        """
        R.Acromium L.Acromium Sternum R.Bicep L.Bicep R.Elbow L.Elbow R.Wrist.Med R.Wrist.Lat L.Wrist.Med L.Wrist.Lat
        R.ASIS R.PSIS S2 L.PSIS L.ASIS R.TH1 R.TH2 R.TH3 R.Knee R.SH1 R.SH2 R.SH3 R.SH4 R.Ankle R.Heel R.MT5 R.MT1
        R.Toe.Tip L.TH1 L.TH2 L.TH3 L.TH4 L.Knee L.SH1 L.SH2 L.SH3 L.Ankle L.Heel L.MT5 L.MT1 L.Toe.Tip R.MKnee R.MAnkle
        L.MKnee L.MAnkle
        """,
    ),
    "m2s": (
        "",
        """
        LBHD RBHD C7 CLAV STRN RBAC LSHO LUPA LRAD LWRA LCAR RSHO RHUM RRAD RWRA RWRB RCAR RFWT LKNE LTARI RTHI RKNI
        RHEE RTOE ROHAND LOHAND RTFIB LWRB RKNE LTFIB RANE LKNI LFWT LHUM LTHI LHEE LBWT RBWT LFHD T10 RFHD LANI RUPA
        LANE LTOE RANI LTAR RTARI RTAR
        """,
    ),
    "lk-clusters": (
        "arms-missing",
        """
        RASIS LASIS RPSIS LPSIS RTH1 RTH2 RTH3 RTH4 LTH1 LTH2 LTH3 LTH4 RLK LLK RSK1 RSK2 RSK3 RSK4 LSK1 LSK2 LSK3 LSK4
        RLA RHEE RPCA RLCA RP1MT RD1MT RP5MT RD5MT RTOE RHLX LLA LHEE LPCA LLCA LP1MT LD1MT LP5MT LD5MT LTOE LHLX RAC
        LAC C7 STRN1 STRN2
        """,
    ),
    "upper-sacrum": (
        "",
        """
        FHD LBHD RBHD C7 T10 CLAV LSHO LUUPA LMUPA LDUPA LLEP LMEP LRAD LUL LRFIN RSHO RUPA1 RMUPA RDUPA RLEP RMEP RRAD
        RUL RUFIN LASI RASI USACR LSACR RSACR LTHI1 LTHI2 LTHI3 LTHI4 LLFC LMFC LTIB1 LTIB2 LTIB3 LTIB4 LLMAL LMMAL LHEE
        LMT1 LMT2 LMT5 RTHI RTHI2 RTHI3 RTHI4 RLFC RMFC RTIB1 RTIB2 RTIB3 RTIB4 RLMAL RMMAL RHEE RMT1 RMT2 RMT5
        """,
    ),
    "heel-sup": (
        "",
        """
        C7 Sternum MidT L.ASIS R.ASIS L.PSIS R.PSIS L.Acromion L.Elbow.Med L.Elbow.Lat L.Radius L.Ulna R.Acromion
        R.Elbow.Med R.Elbow.Lat R.Ulna R.Radius L.Thigh.Post.Sup L.Thigh.Ant.Sup L.Thigh.Post.Inf L.Thigh.Ant.Inf
        L.Knee.Med L.Knee.Lat L.Shank.Post.Sup L.Shank.Ant.Sup L.Shank.Post.Inf L.Shank.Ant.Inf L.Ankle.Med L.Ankle.Lat
        L.Heel.Sup L.Heel.Inf L.Heel.~Med L.Heel.Lat L.Midfoot.Med L.Midfoot.Int L.Midfoot.Lat L.MTP1 L.MTP2 L.MTP5
        L.Toe R.Thigh.Post.Sup R.Thigh.Ant.Sup R.Thigh.Post.Inf R.Thigh.Ant.Inf R.Knee.Med R.Knee.Lat R.Shank.Post.Sup
        R.Shank.Ant.Sup R.Shank.Post.Inf R.Shank.Ant.Inf R.Ankle.Med R.Ankle.Lat R.Heel.Sup R.Heel.Inf R.Heel.Med
        R.Heel.Lat R.Midfoot.Med R.Midfoot.Int R.Midfoot.Lat R.MTP1 R.MTP2 R.MTP5 R.Toe
        """,
    ),
    "knee-el": (
        "trunk-missing",
        """
        L_MAL_M R_MAL_M R_ASIS L_KNEE_EL L_HEEL R_META L_TIB_DIAF R_TIB_DIAF R_KNEE_EM L_ASIS R_Barra R_HEEL L_META
        R_FEM_DIAF L_KNEE_EM R_MAL_L R_KNEE_EL SACRUM L_FEM_DIAF L_MAL_L L_Barra
        """,
    ),
    "patella-clusters": (
        "",
        """
        L.Toe L.Midfoot.Superior Neck R.Toe R.Heel L.Heel R.Elbow R.Shoulder L.Shank.Inferior L.Shoulder
        L.Shank.Superior R.Shank.Lateral L.Patella L.Thigh.Inferior R.Wrist R.Midfoot.Superior L.Shank.Lateral Sternum
        L.Elbow R.Midfoot.Lateral L.Thigh.Superior L.Wrist R.Thigh.Superior L.Thigh.Lateral R.Shank.Inferior
        L.Midfoot.Lateral R.Shank.Superior R.Thigh.Lateral L.Asis R.Thigh.Inferior R.Patella Sacral R.Asis
        """,
    ),
    "cortex-five-letters": (
        "",
        """
        THEAD FHEAD RHEAD RSHOU ROFFS RELBO RWRIS LSHOU LELBO LWRIS RASIS LASIS VSACR RTHIG RKNEE RSHAN RANKL RHEEL
        R.TOE LTHIG LKNEE LSHAN LANKL LHEEL L.TOE
        """,
    ),
    "gait2354 with metatarsals": (
        "arms-missing",
        """
        V_Sacral R_ASIS L_ASIS R_Knee_Lat R_Thigh_Upper R_Thigh_Front R_Thigh_Rear L_Knee_Lat L_Thigh_Upper
        L_Thigh_Front L_Thigh_Rear R_Ankle_Lat R_Shank_Upper R_Shank_Front R_Shank_Rear L_Ankle_Lat L_Shank_Upper
        L_Shank_Front L_Shank_Rear R_Heel R_MTP1 R_MTP5 L_Heel L_MTP1 L_MTP5 Clavicle R_Acromium L_Acromium
        """,
    ),
    "lt-rt": (
        "",
        """
        LTAS RTAS LTPS RTPS SACR SPC1 SPC2 SPC3 SPT1 SPT2 SPT3 SPT4 SPT5 SPL1 SPL2 SPL3 SPL4 SPL5 STER LTSH RTSH LTEL
        RTEL LTRA RTRA LTUL RTUL LTCL RTCL LTSC RTSC LTLH RTLH LTLL RTLL LTFR RTFR LTLE RTLE LTME RTME LTHF RTHF LTTT
        RTTT LTMT RTMT LTLF RTLF LTLM RTLM LTMM RTMM LTHL RTHL LTLC RTLC LTMC RTMC LTFM RTFM LTTO RTTO LTVM RTVM
        """,
    ),
}
